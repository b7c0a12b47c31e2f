// See kernel_files.h. PoCL 3.1 keeps FOLDER/AB/HASH/program.bc, and FOLDER/AB/HASH/KERNEL/SIZES/KERNEL.so beside it.
#include "runtime/kernel_files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cstdint>
#include <cstring>
#include <ctime>
#include <exception>
#include <fstream>
#include <string>
#include <vector>

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr char kStamp[] = "cloam-checked";  // its time is that of the last check
constexpr time_t kSettled = 120;  // seconds after which a file is on the disk: before, a power cut may empty it
constexpr time_t kLongest = 600;  // seconds that compiling for one size takes at most

template <class Number>
bool read_at(std::ifstream& file, uint64_t at, Number& out) {
  file.seekg(static_cast<std::streamoff>(at));
  return static_cast<bool>(file.read(reinterpret_cast<char*>(&out), sizeof out));
}

/// Of an ELF file of 64 bits: the table of its sections, which is its end, is there and no zeros. Others pass.
bool is_whole_library(std::ifstream& file, uint64_t size) {
  std::array<unsigned char, 5> magic{};
  if (!read_at(file, 0, magic) || std::memcmp(magic.data(), "\177ELF", 4) != 0) return false;
  if (magic[4] != 2) return true;
  uint64_t table = 0;
  uint16_t each = 0, count = 0, names = 0;
  if (!read_at(file, 0x28, table) || !read_at(file, 0x3A, each) || !read_at(file, 0x3C, count) ||
      !read_at(file, 0x3E, names))
    return false;
  constexpr uint32_t kStrings = 3;  // SHT_STRTAB
  uint32_t type = 0;
  return table <= size && uint64_t{each} * count <= size - table && names < count &&
         read_at(file, table + uint64_t{names} * each + 4, type) && type == kStrings;
}

/// Of LLVM bitcode: its blocks, each of which states its length, fill the file. Other formats pass.
bool is_whole_bitcode(std::ifstream& file, uint64_t size) {
  uint32_t magic = 0;
  if (!read_at(file, 0, magic) || magic == 0) return false;
  if (magic != 0xDEC04342) return true;
  uint64_t at = 4;
  while (at < size) {
    std::array<uint32_t, 2> head{};  // "enter a block" in two bits, its id in eight, a width in four; its words
    if (!read_at(file, at, head) || (head[0] & 3u) != 1) return false;
    at += 8 + 4 * uint64_t{head[1]};
  }
  return at == size;
}

bool is_whole(const fs::path& path, uint64_t size) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return true;  // of another user
  return path.extension() == ".so" ? is_whole_library(file, size) : is_whole_bitcode(file, size);
}

/// Zero: never.
time_t last_check(const fs::path& folder) {
  struct stat found {};
  return ::stat((folder / kStamp).c_str(), &found) == 0 ? found.st_mtime : 0;
}

void note_check(const fs::path& folder) {
  const int file = ::open((folder / kStamp).c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
  if (file < 0) return;
  ::futimens(file, nullptr);
  ::close(file);
}

/// The folders in one whose names are so many letters from A to P, PoCL's digits: no other folder is ever looked into.
std::vector<fs::path> folders_of_pocl(const fs::path& in, size_t least, size_t most) {
  std::vector<fs::path> out;
  std::error_code error;
  for (fs::directory_iterator entry(in, error), end; !error && entry != end; entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    const bool fits = name.size() >= least && name.size() <= most;
    if (fits && name.find_first_not_of("ABCDEFGHIJKLMNOP") == std::string::npos) out.push_back(entry->path());
  }
  return out;
}

/// A kernel's folder gets another one for each size before that is compiled: those that got none lately hold nothing
/// that changed. Caches grow to thousands of kernels, and each start of a program looks.
bool is_damaged(const fs::path& program, time_t since) {
  std::error_code error;
  for (fs::recursive_directory_iterator entry(program, error), end; !error && entry != end; entry.increment(error)) {
    const fs::path& path = entry->path();
    struct stat found {};
    if (entry.depth() == 0 && entry->is_directory(error)) {
      if (::stat(path.c_str(), &found) == 0 && found.st_ctime < since - kLongest) entry.disable_recursion_pending();
      continue;
    }
    const bool is_kernel = path.extension() == ".so" || path.filename() == "program.bc";
    if (!is_kernel || ::lstat(path.c_str(), &found) != 0 || !S_ISREG(found.st_mode) || found.st_ctime < since) continue;
    if (!is_whole(path, static_cast<uint64_t>(found.st_size))) return true;
  }
  return false;
}

}  // namespace

int remove_damaged_kernels(const fs::path& folder) {
  int removed = 0;
  try {
    const time_t since = last_check(folder) - kSettled;
    const std::vector<fs::path> all = folders_of_pocl(folder, 2, 2);
    if (all.empty()) return 0;
    for (const fs::path& some : all)
      for (const fs::path& program : folders_of_pocl(some, 30, 64)) {
        std::error_code error;
        if (is_damaged(program, since) && fs::remove_all(program, error) > 0) removed++;
      }
    note_check(folder);
  } catch (const std::exception&) {  // no memory for a path: then no more is checked
  }
  return removed;
}

}  // namespace cloam
