// Shapes, broadcasting and argument patterns.
#include "runtime/shape.h"

#include <algorithm>
#include <cctype>
#include <sstream>
#include <vector>

#include "runtime/error.h"
#include "runtime/tensor.h"

namespace cloam {

Shape::Shape(std::initializer_list<int64_t> sizes) {
  for (int64_t size : sizes) push_back(size);
}

Shape Shape::filled(int rank, int64_t value) {
  Shape shape;
  for (int i = 0; i < rank; i++) shape.push_back(value);
  return shape;
}

void Shape::push_back(int64_t size) {
  if (rank_ == kMaxRank) throw Error(Fault::internal, text("[shape] more than ", kMaxRank, " axes"));
  sizes_[static_cast<size_t>(rank_++)] = size;
}

bool Shape::operator==(const Shape& other) const { return std::equal(begin(), end(), other.begin(), other.end()); }

int64_t numel(const Shape& shape) {
  constexpr int64_t kMost = int64_t{1} << 60;  // their bytes can still be counted
  int64_t count = 1;
  for (int64_t size : shape) {
    if (size < 0) throw Error(Fault::internal, text("[shape] ", to_string(shape), " has a negative extent"));
    if (__builtin_mul_overflow(count, size, &count) || count > kMost)
      throw Error(Fault::memory,
                  text("a tensor of shape ", to_string(shape), " has more values than any memory holds"));
  }
  return count;
}

std::string to_string(const Shape& shape) {
  std::string out = "[";
  for (int i = 0; i < shape.rank(); i++) out += (i ? "," : "") + std::to_string(shape[i]);
  return out + "]";
}

Shape dense_strides(const Shape& shape) {
  Shape strides = shape;
  int64_t step = 1;
  for (int i = shape.rank() - 1; i >= 0; i--) {
    strides[i] = step;
    step *= shape[i];
  }
  return strides;
}

Shape broadcast(const char* op, const Shape& a, const Shape& b) {
  const Shape& longer = a.rank() >= b.rank() ? a : b;
  const Shape& shorter = a.rank() >= b.rank() ? b : a;
  Shape out = longer;
  for (int i = 1; i <= shorter.rank(); i++) {
    const int64_t one = longer[longer.rank() - i], two = shorter[shorter.rank() - i];
    if (one != two && one != 1 && two != 1)
      throw Error(Fault::internal, text("[", op, "] shapes ", to_string(a), " and ", to_string(b),
                                        " do not broadcast: ", one, " against ", two, " on axis -", i));
    out[out.rank() - i] = one == 1 ? two : one;
  }
  return out;
}

int axis_of(const char* op, int rank, int axis) {
  const int at = axis < 0 ? axis + rank : axis;
  if (at < 0 || at >= rank)
    throw Error(Fault::internal, text("[", op, "] axis ", axis, " is outside a tensor of ", rank, " axes"));
  return at;
}

namespace {

struct Seen {
  int64_t size;
  const char* where;
};

[[noreturn]] void mismatch(const char* op, const Want& want, const std::string& why) {
  throw Error(Fault::internal, text("[", op, "] ", want.name, " has shape ", to_string(want.tensor.shape()), ", want [",
                                    want.pattern, "]: ", why));
}

void match_one(const char* op, const Want& want, std::map<std::string, Seen>& seen) {
  std::istringstream words(want.pattern);
  std::vector<std::string> names;
  for (std::string word; words >> word;) names.push_back(word);
  const Shape& shape = want.tensor.shape();
  if (static_cast<int>(names.size()) != shape.rank())
    mismatch(op, want, text("it has ", shape.rank(), " axes, not ", names.size()));
  for (int i = 0; i < shape.rank(); i++) {
    const std::string& name = names[static_cast<size_t>(i)];
    const bool number = std::isdigit(static_cast<unsigned char>(name[0])) != 0;
    const auto [at, fresh] = seen.try_emplace(name, Seen{number ? std::stoll(name) : shape[i], want.name});
    if (at->second.size != shape[i])
      mismatch(
          op, want,
          text(name, " is ", at->second.size, fresh ? "" : text(" in ", at->second.where), " but ", shape[i], " here"));
  }
}

}  // namespace

Dims match(const char* op, std::initializer_list<Want> wants) {
  std::map<std::string, Seen> seen;
  for (const Want& want : wants) match_one(op, want, seen);
  Dims out;
  for (const auto& [name, found] : seen) out.emplace(name, found.size);
  return out;
}

}  // namespace cloam
