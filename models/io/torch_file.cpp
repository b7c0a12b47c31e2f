// See torch_file.h. What a pickle says of a storage, ("storage", type, key, place, count), and of a tensor, (storage,
// offset, sizes, strides), is torch/serialization.py's and torch/_utils.py's.
#include "models/io/torch_file.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <map>
#include <optional>

#include "models/io/bytes.h"
#include "models/io/pickle.h"
#include "models/io/safetensors_header.h"  // dtype_bytes, printable, shape_text
#include "runtime/error.h"

namespace cloam {
namespace {

using ByteSpan = std::span<const std::uint8_t>;

constexpr std::string_view kPickle = "/data.pkl";
constexpr std::array<std::uint8_t, 15> kTorchMagic = {0x80, 2,    0x8a, 10,   0x6c, 0xfc, 0x9c, 0x46,
                                                      0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19, '.'};
constexpr std::int64_t kProtocol = 1001;
constexpr std::size_t kMaxTensorRank = 8;
constexpr std::uint64_t kMaxShared = 4;  // tensors may share storages; all together are so many times the file at most

const char* dtype_of(PickleName name) {
  switch (name) {
    case PickleName::storage_f64:
      return "F64";
    case PickleName::storage_f32:
      return "F32";
    case PickleName::storage_f16:
      return "F16";
    case PickleName::storage_bf16:
      return "BF16";
    case PickleName::storage_i64:
      return "I64";
    case PickleName::storage_i32:
      return "I32";
    case PickleName::storage_i16:
      return "I16";
    case PickleName::storage_i8:
      return "I8";
    case PickleName::storage_u8:
      return "U8";
    case PickleName::storage_bool:
      return "BOOL";
    default:
      return nullptr;
  }
}

/// Numbers of one type, which tensors are parts of.
struct Storage {
  std::string key, dtype;
  std::uint64_t count = 0;

  std::uint64_t bytes() const { return count * dtype_bytes(dtype); }
};

Storage storage_of(const Pickle& pickle, const PickleRecord& record) {
  const PickleValue& value = record.arguments[0];
  const auto parts = pickle.list(value, "a storage's description");
  if (parts.size() < 5 || pickle.text(parts[0], "the word storage") != "storage")
    pickle.unlike(value, "a storage's type, key, place and number of values");
  if (parts.size() > 5 && parts[5].kind != PickleValue::Kind::none)
    pickle.unlike(parts[5], "a storage of its own (it is part of another: load and save the file again with PyTorch)");
  const char* dtype = dtype_of(pickle.name(parts[1], "a type of storage"));
  const std::int64_t count = pickle.integer(parts[4], "a storage's number of values");
  if (!dtype || count < 0 || count > std::int64_t{1} << 40) pickle.unlike(value, "a type of storage and a sound size");
  return {std::string(pickle.text(parts[2], "a storage's key")), dtype, static_cast<std::uint64_t>(count)};
}

/// Where storages lie in the file, by their keys.
using Storages = std::map<std::string, ByteSpan>;

class StateDict {
 public:
  StateDict(const Pickle& pickle, Storages storages, std::uint64_t file_size)
      : pickle_(pickle), storages_(std::move(storages)), left_(kMaxShared * file_size) {}

  TensorMap tensors() {
    const auto items = pickle_.items(pickle_.root(), "a dict of tensors, a state_dict()");
    TensorMap all;
    for (std::size_t i = 0; i + 1 < items.size(); i += 2) {
      const auto parts = parts_of(items[i + 1]);
      if (parts) all.insert_or_assign(std::string(pickle_.text(items[i], "a tensor's name")), tensor(items[i], *parts));
    }
    return all;
  }

 private:
  using Parts = std::span<const PickleValue>;

  [[noreturn]] void fail(const PickleValue& name, const std::string& why) const {
    bad_data(pickle_.file(), ": ", printable(pickle_.text(name, "a tensor's name")), ": ", why);
  }

  /// Arguments of the function that makes a tensor, or the state of one that is made without; for a parameter, those of
  /// the tensor in it.
  std::optional<Parts> parts_of(const PickleValue& value, bool inside = false) const {
    if (value.kind != PickleValue::Kind::record) return {};
    const PickleRecord& record = pickle_.record(value, "a tensor");
    const auto is_list = [](const PickleValue& of) {
      return of.kind == PickleValue::Kind::tuple || of.kind == PickleValue::Kind::list;
    };
    const Parts state = record.has_state && is_list(record.state) ? pickle_.list(record.state, "a state") : Parts{};
    if (record.name == PickleName::parameter && !inside)
      for (const Parts from : {Parts(record.arguments), state})
        if (!from.empty() && from[0].kind == PickleValue::Kind::record)
          if (const auto parts = parts_of(from[0], true)) return parts;
    if (record.name != PickleName::tensor && record.name != PickleName::parameter) return {};
    if (record.arguments.size() >= 4) return Parts(record.arguments).first(4);
    if (state.size() == 4) return state;
    return {};
  }

  std::vector<std::int64_t> numbers(const PickleValue& name, const PickleValue& list) const {
    std::vector<std::int64_t> all;
    for (const PickleValue& one : pickle_.list(list, "a tensor's sizes")) {
      all.push_back(pickle_.integer(one, "a size"));
      if (all.back() < 0) fail(name, text("a size or stride of ", all.back()));
    }
    if (all.size() > kMaxTensorRank) fail(name, text(all.size(), " axes, the most is ", kMaxTensorRank));
    return all;
  }

  NamedTensor tensor(const PickleValue& name, Parts parts) {
    const Storage storage = storage_of(pickle_, pickle_.record(parts[0], PickleName::persistent, "a tensor's storage"));
    const std::int64_t offset = pickle_.integer(parts[1], "a tensor's offset");
    NamedTensor result{storage.dtype, numbers(name, parts[2]), {}};
    const std::vector<std::int64_t> strides = numbers(name, parts[3]);
    if (strides.size() != result.shape.size()) fail(name, "as many strides as sizes were looked for");
    const std::uint64_t count = values_of(name, result.shape, strides, offset, storage);
    const std::uint64_t width = dtype_bytes(storage.dtype);
    if (count * width > left_) fail(name, text("its tensors are more than ", kMaxShared, " times the file"));
    left_ -= count * width;
    const ByteSpan from = storages_.at(storage.key);
    result.data.resize(count * width);
    copy(from.subspan(count > 0 ? static_cast<std::uint64_t>(offset) * width : 0), strides, width, result);
    return result;
  }

  /// The number of values, all of which lie in the storage.
  std::uint64_t values_of(const PickleValue& name, const std::vector<std::int64_t>& sizes,
                          const std::vector<std::int64_t>& strides, std::int64_t offset, const Storage& storage) const {
    const auto most = static_cast<std::int64_t>(storage.count);
    const auto outside = [&] {
      fail(name,
           text(shape_text(sizes), " from value ", offset, " on lies outside of its storage of ", most, " values"));
    };
    if (std::count(sizes.begin(), sizes.end(), 0) > 0) return 0;
    std::int64_t count = 1, last = offset;
    if (offset < 0 || offset >= most) outside();
    for (std::size_t axis = 0; axis < sizes.size(); axis++) {
      if (sizes[axis] > most / count) outside();
      count *= sizes[axis];
      if (sizes[axis] == 1) continue;
      if (strides[axis] > (most - 1 - last) / (sizes[axis] - 1)) outside();
      last += strides[axis] * (sizes[axis] - 1);
    }
    return static_cast<std::uint64_t>(count);
  }

  static void copy(ByteSpan from, const std::vector<std::int64_t>& strides, std::uint64_t width, NamedTensor& to) {
    const std::size_t rank = to.shape.size();
    std::vector<std::int64_t> at(rank, 0);
    std::int64_t place = 0;
    for (std::size_t done = 0; done < to.data.size(); done += width) {
      std::memcpy(to.data.data() + done, from.data() + static_cast<std::uint64_t>(place) * width, width);
      for (std::size_t axis = rank; axis-- > 0;) {
        place += strides[axis];
        if (++at[axis] < to.shape[axis]) break;
        place -= strides[axis] * at[axis];
        at[axis] = 0;
      }
    }
  }

  const Pickle& pickle_;
  Storages storages_;
  std::uint64_t left_;  // bytes that tensors may still take
};

/// All that the pickle speaks of, by their keys; Fault::data if two places of it disagree.
std::map<std::string, Storage> named_storages(const Pickle& pickle) {
  std::map<std::string, Storage> all;
  for (const PickleRecord& record : pickle.records()) {
    if (record.name != PickleName::persistent) continue;
    const Storage storage = storage_of(pickle, record);
    const Storage& known = all.emplace(storage.key, storage).first->second;
    if (known.dtype != storage.dtype || known.count != storage.count)
      bad_data(pickle.file(), ": storage ", printable(storage.key), " is of two types or sizes");
  }
  return all;
}

const ZipEntry* member(const Zip& zip, const std::string& name) {
  const auto at = std::find_if(zip.entries().begin(), zip.entries().end(),
                               [&](const ZipEntry& entry) { return entry.name == name; });
  return at == zip.entries().end() ? nullptr : &*at;
}

const ZipEntry* pickle_of(const Zip& zip) {
  const auto at = std::find_if(zip.entries().begin(), zip.entries().end(),
                               [](const ZipEntry& entry) { return entry.name.ends_with(kPickle); });
  return at == zip.entries().end() ? nullptr : &*at;
}

void need_little_endian(const Zip& zip, const std::string& folder) {
  const ZipEntry* entry = member(zip, folder + "/byteorder");
  if (!entry) return;
  const std::vector<std::uint8_t> order = zip.content(*entry);
  if (std::string(order.begin(), order.end()) != "little")
    bad_data(zip.name(), ": its numbers are big-endian; save it again on a little-endian machine");
}

/// Behind the pickles: of each key in their order the number of values, then the values.
Storages old_storages(const std::map<std::string, Storage>& named, const Pickle& keys, ByteSpan rest) {
  ByteReader reader(rest, keys.file());
  Storages all;
  for (const PickleValue& value : keys.list(keys.root(), "a list of storages' keys")) {
    const std::string key(keys.text(value, "a storage's key"));
    const auto at = named.find(key);
    if (at == named.end())
      bad_data(keys.file(), ": no tensor has the storage ", printable(key), " that its list names");
    const auto count = reader.little<std::uint64_t>("a storage's size");
    if (count != at->second.count)
      bad_data(keys.file(), ": storage ", printable(key), " has ", count, " values, its tensors speak of ",
               at->second.count);
    all[key] = reader.take(at->second.bytes(), "a storage");
  }
  for (const auto& [key, storage] : named)
    if (!all.count(key)) bad_data(keys.file(), ": storage ", printable(key), " is missing; the file is damaged");
  return all;
}

}  // namespace

bool is_torch(const Zip& zip) { return pickle_of(zip) != nullptr; }

bool is_old_torch(ByteSpan bytes) {
  return bytes.size() >= kTorchMagic.size() && std::equal(kTorchMagic.begin(), kTorchMagic.end(), bytes.begin());
}

TensorMap torch_tensors(const Zip& zip) {
  const ZipEntry* entry = pickle_of(zip);
  if (!entry) bad_data(zip.name(), ": looked for a member data.pkl, as torch.save writes it, found none");
  const std::string folder = entry->name.substr(0, entry->name.size() - kPickle.size());
  need_little_endian(zip, folder);
  const std::vector<std::uint8_t> content = zip.content(*entry);
  const Pickle pickle(content, zip.name() + ": " + printable(entry->name), PickleUse::tensors);
  Storages storages;
  for (const auto& [key, storage] : named_storages(pickle)) {
    const ZipEntry* values = member(zip, folder + "/data/" + key);
    if (!values) bad_data(zip.name(), ": looked for a member data/", printable(key), ", found none");
    if (values->content != storage.bytes())
      bad_data(zip.name(), ": member data/", printable(key), " has ", values->content, " bytes, its tensors speak of ",
               storage.bytes());
    storages[key] = zip.stored(*values);
  }
  return StateDict(pickle, storages, zip.size()).tensors();
}

TensorMap old_torch_tensors(ByteSpan bytes, const std::string& name) {
  std::size_t at = kTorchMagic.size();
  const auto next = [&] {
    Pickle pickle(bytes.subspan(at), text(name, ": pickle at byte ", at), PickleUse::tensors);
    at += pickle.length();
    return pickle;
  };
  const Pickle protocol = next();
  if (protocol.integer(protocol.root(), "a protocol") != kProtocol)
    bad_data(name, ": looked for PyTorch's protocol ", kProtocol, ", found another");
  const Pickle system = next();
  const PickleValue* little = system.find(system.root(), "little_endian", "what the machine was");
  if (!little || little->kind != PickleValue::Kind::boolean || little->integer != 1)
    bad_data(name, ": its numbers are big-endian; save it again on a little-endian machine");
  const Pickle state = next(), keys = next();
  return StateDict(state, old_storages(named_storages(state), keys, bytes.subspan(at)), bytes.size()).tensors();
}

}  // namespace cloam
