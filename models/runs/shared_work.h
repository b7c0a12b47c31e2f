// Work in items of which none needs another, shared out among ranks: pictures, assets, sweeps.
#pragma once
#include <cstddef>
#include <cstring>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <type_traits>
#include <vector>

#include "models/runs/listener.h"
#include "models/train/ranks.h"

namespace cloam {

struct SharedWork {
  std::size_t count = 0;  // items
  /// Does one item. Returns what all ranks are to know of it: figures, not what lies in files.
  std::function<nlohmann::ordered_json(std::size_t item)> make;
  /// Of the items that are done where the work is stopped, such as "3 of 8 pictures are complete in pictures".
  std::function<std::string(std::size_t done)> complete;
};

/// Item i is made by rank i mod N. Returns what was made of each, in the order of the items, the same on every rank.
/// Ranks that are asked to stop all end the item that they are at, and all throw Interrupted. Whatever else an item
/// throws is thrown at once, on its rank alone.
std::vector<nlohmann::ordered_json> share_out(const Ranks& ranks, const Listener& listener, const SharedWork& work);

/// Many numbers as what an item made, and back.
template <class Value>
nlohmann::ordered_json packed(const std::vector<Value>& values) {
  static_assert(std::is_trivially_copyable_v<Value>);
  std::vector<std::uint8_t> bytes(values.size() * sizeof(Value));
  if (!bytes.empty()) std::memcpy(bytes.data(), values.data(), bytes.size());
  return nlohmann::ordered_json::binary(std::move(bytes));
}
template <class Value>
std::vector<Value> unpacked(const nlohmann::ordered_json& made) {
  const std::vector<std::uint8_t>& bytes = made.get_binary();
  std::vector<Value> values(bytes.size() / sizeof(Value));
  if (!values.empty()) std::memcpy(values.data(), bytes.data(), bytes.size());
  return values;
}

}  // namespace cloam
