// Reading variant rows out of kernel texts, choosing among them, and remembering what tuning found.
#include "runtime/variant.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <fstream>
#include <map>
#include <optional>
#include <set>
#include <sstream>

#include "runtime/cache_folder.h"
#include "runtime/cl.h"
#include "runtime/device_lock.h"
#include "runtime/hash.h"

namespace cloam {
namespace {

constexpr char kMark[] = "//: variant ";

const char* interned(const std::string& name) {
  static auto* const names = new std::set<std::string>;
  return names->insert(name).first->c_str();
}

[[noreturn]] void bad_row(const std::string& stem, const std::string& line) {
  throw Error(Fault::internal, text("kernels/", stem, ".cl: \"", line,
                                    "\"; want //: variant <kernel> <cpu|gpu|reference> <size> NAME=VALUE ..."));
}

Variant parse_row(const std::string& stem, const std::string& line) {
  std::istringstream words(line.substr(std::strlen(kMark)));
  Variant row;
  row.stem = stem;
  words >> row.kernel >> row.where >> row.size;
  if (row.size.empty() || (row.where != "cpu" && row.where != "gpu" && row.where != "reference")) bad_row(stem, line);
  for (std::string word; words >> word;) {
    const size_t equal = word.find('=');
    int value = 0;
    if (equal == std::string::npos || std::sscanf(word.c_str() + equal + 1, "%d", &value) != 1) bad_row(stem, line);
    row.constants.push_back({interned(word.substr(0, equal)), value});
  }
  return row;
}

void read_rows(const std::string& stem, std::deque<Variant>& rows) {
  std::istringstream source(kernel_text(stem));
  for (std::string line; std::getline(source, line);)
    if (line.starts_with(kMark)) rows.push_back(parse_row(stem, line));
}

struct Family {
  std::deque<Variant> rows;  // a deque: choices point into it
  std::map<std::string, Choice> chosen;
};

Family& family_of(const std::string& name) {
  static auto* const families = new std::map<std::string, Family>;
  auto [at, fresh] = families->try_emplace(name);
  if (!fresh) return at->second;
  for (const char* suffix : {"", "_cpu", "_gpu"})
    if (has_kernel_text(name + suffix)) read_rows(name + suffix, at->second.rows);
  return at->second;
}

bool states_reference(const std::string& family) {
  const std::deque<Variant>& rows = family_of(family).rows;
  return std::any_of(rows.begin(), rows.end(), [](const Variant& row) { return row.where == "reference"; });
}

std::vector<std::string>& off() {
  static auto* const families = new std::vector<std::string>;
  return *families;
}

bool is_off(const std::string& family) { return std::find(off().begin(), off().end(), family) != off().end(); }

const char* class_here() { return is_cpu_class() ? "cpu" : "gpu"; }

const char* class_for(const std::string& family) {
  return reference_variants() || is_off(family) ? "reference" : class_here();
}

/// Is a group of so many lanes one that the device can have?
bool group_fits(const Variant& row) {
  for (const auto& [name, value] : row.constants)
    if (std::strcmp(name, "LANES") == 0) return value <= device().max_work_group;
  return true;
}

/// The rows of one kernel whose groups fit: those of the device class whose size fits exactly, then "any", then the
/// references.
std::vector<const Variant*> fitting(const std::string& family, const std::string& size) {
  for (const std::string& where : {std::string(class_for(family)), std::string("reference")})
    for (const std::string& wanted : {size, std::string("any")}) {
      std::vector<const Variant*> out;
      for (const Variant& row : family_of(family).rows)
        if (row.where == where && row.size == wanted && group_fits(row) &&
            (out.empty() || row.kernel == out[0]->kernel))
          out.push_back(&row);
      if (!out.empty()) return out;
    }
  throw Error(Fault::internal, text("[variant] kernels/", family, "*.cl states no row for ", class_for(family),
                                    " and size ", size, ", and no reference"));
}

/// family|size|kernel NAME=VALUE ..., as with_tuned() writes it.
using Tuned = std::map<std::pair<std::string, std::string>, std::string>;

Tuned read_tuned() {
  Tuned out;
  const char* wish = std::getenv("CLOAM_TUNE");
  if (wish && std::strcmp(wish, "off") == 0) return out;
  std::ifstream file(tuned_file());
  for (std::string line; std::getline(file, line);) {
    const size_t first = line.find('|'), second = line.find('|', first + 1);
    if (line.starts_with('#') || second == std::string::npos) continue;
    out[{line.substr(0, first), line.substr(first + 1, second - first - 1)}] = line.substr(second + 1);
  }
  return out;
}

Choice first_choice(const std::string& family, const std::string& size) {
  static auto* const tuned = new Tuned(read_tuned());
  const std::vector<const Variant*> rows = fitting(family, size);
  const auto found = tuned->find({family, size});
  if (found != tuned->end() && !runs_reference(family.c_str()))
    for (const Variant* row : rows)
      if (row->row() == found->second) return {family, size, row, "tuned"};
  const char* why = reference_variants()            ? "CLOAM_VARIANT=reference"
                    : is_off(family)                ? "selftest found the others wrong"
                    : rows[0]->where == "reference" ? "no row for this device class"
                                                    : "built-in";
  return {family, size, rows[0], why};
}

thread_local std::vector<Choice>* choice_recorder = nullptr;  // of what this thread chooses

void record(const Choice& choice) {
  for (const Choice& known : *choice_recorder)
    if (known.family == choice.family && known.size == choice.size) return;
  choice_recorder->push_back(choice);
}

const Choice& choice_for(const char* family, const char* size) {
  static auto* const quick = new std::map<std::pair<const char*, const char*>, const Choice*>;
  const Choice*& known = (*quick)[{family, size}];
  if (known) return *known;
  std::map<std::string, Choice>& chosen = family_of(family).chosen;
  const auto found = chosen.find(size);
  known = found != chosen.end() ? &found->second : &chosen.emplace(size, first_choice(family, size)).first->second;
  return *known;
}

}  // namespace

int Variant::operator[](const char* name) const {
  for (const auto& [known, value] : constants)
    if (std::strcmp(known, name) == 0) return value;
  throw Error(Fault::internal, text("[variant] ", kernel, " in kernels/", stem, ".cl states no ", name));
}

std::string Variant::row() const {
  std::string out = text(kernel, " ", where, " ", size);
  for (const auto& [name, value] : constants) out += text(" ", name, "=", value);
  return out;
}

const Variant& choose(const char* family, const char* size) {
  const DeviceLock lock;
  const Choice& choice = choice_for(family, size);
  if (choice_recorder) record(choice);
  return *choice.variant;
}

std::vector<const Variant*> candidates(const std::string& family, const std::string& size) {
  const DeviceLock lock;
  return fitting(family, size);
}

void prefer(const std::string& family, const std::string& size, const Variant& variant, const char* why) {
  const DeviceLock lock;
  family_of(family).chosen[size] = {family, size, &variant, why};
}

void switch_off(const std::vector<std::string>& families) {
  const DeviceLock lock;
  std::vector<std::string> changed = off();
  changed.insert(changed.end(), families.begin(), families.end());
  off() = families;
  for (const std::string& family : changed) {
    if (!states_reference(family)) continue;  // its op asks runs_reference() and composes
    for (auto& [size, choice] : family_of(family).chosen) choice = first_choice(family, size);
  }
}

bool runs_reference(const char* family) {
  const DeviceLock lock;
  return reference_variants() || is_off(family);
}

std::vector<Variant> all_variants() {
  const DeviceLock lock;
  std::deque<Variant> rows;
  for (const std::string& stem : kernel_stems()) read_rows(stem, rows);
  return {rows.begin(), rows.end()};
}

bool states_kernel(const Variant& variant) {
  if (variant.kernel.ends_with("_composed")) return true;
  return kernel_text(variant.stem).find(" " + variant.kernel + "(") != std::string::npos;
}

void record_choices(std::vector<Choice>* into) { choice_recorder = into; }

cl::Kernel& kernel(const Variant& variant, const char* name, const Constants& more) {
  Constants all = variant.constants;
  all.insert(all.end(), more.begin(), more.end());
  return kernel(variant.stem.c_str(), name, all);
}

std::string cache_folder() {
  const auto set = [](const char* name) -> std::optional<std::string> {
    const char* value = std::getenv(name);
    return value && *value ? std::optional<std::string>(value) : std::nullopt;
  };
  if (const auto own = set("CLOAM_CACHE_DIR")) return *own;
  if (const auto xdg = set("XDG_CACHE_HOME")) return *xdg + "/cloam";
  return set("HOME").value_or("/tmp") + "/.cache/cloam";
}

std::string tuned_file() {
  const char* device_class = reference_variants() ? "reference" : class_here();
  const uint64_t hash = fnv1a(device().name + "|" + device().driver + "|" + device_class);
  char name[40];
  std::snprintf(name, sizeof name, "/tuned-%016llx.txt", static_cast<unsigned long long>(hash));
  return cache_folder() + name;
}

std::string with_tuned(const std::vector<Choice>& tuned) {
  Tuned all = read_tuned();
  for (const Choice& choice : tuned) all[{choice.family, choice.size}] = choice.variant->row();
  std::string out =
      text("# ", device().name, ", driver ", device().driver, ": written by cloam tune; delete it to forget\n");
  for (const auto& [place, row] : all) out += text(place.first, '|', place.second, '|', row, '\n');
  return out;
}

}  // namespace cloam
