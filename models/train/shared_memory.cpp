// See shared_memory.h. The first rank makes a file without a name (memfd_create), the others open it through /proc.
#include "models/train/shared_memory.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstring>
#include <string>
#include <utility>

namespace cloam {
namespace {

constexpr size_t kHugePage = size_t{2} << 20;
using Seal = std::array<int64_t, 2>;  // behind the bytes: another host's process of that number has no such file

class File {
 public:
  explicit File(int number) : number_(number) {}
  ~File() {
    if (number_ >= 0) close(number_);
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  int number() const { return number_; }

 private:
  int number_;
};

/// A whole number of huge pages, with room for the seal. Large pages are a hint: rows of tables miss fewer
/// translations.
std::shared_ptr<std::byte> mapped(const File& file, size_t bytes) {
  if (file.number() < 0) return nullptr;
  void* const at = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, file.number(), 0);
  if (at == MAP_FAILED) return nullptr;
  madvise(at, bytes, MADV_HUGEPAGE);
  return {static_cast<std::byte*>(at), [bytes](std::byte* memory) { munmap(memory, bytes); }};
}

int new_file(size_t bytes) {
  const int file = memfd_create("cloam ranks", MFD_CLOEXEC);
  if (file < 0) return -1;
  if (ftruncate(file, static_cast<off_t>(bytes)) == 0) return file;
  close(file);
  return -1;
}

int opened_file(int64_t process, int64_t number, size_t bytes) {
  const std::string name = "/proc/" + std::to_string(process) + "/fd/" + std::to_string(number);
  const int file = open(name.c_str(), O_RDWR | O_CLOEXEC);
  if (file >= 0 && lseek(file, 0, SEEK_END) == static_cast<off_t>(bytes)) return file;
  if (file >= 0) close(file);
  return -1;
}

Seal seal_of(const std::byte* memory, size_t bytes) {
  Seal seal;
  std::memcpy(&seal, memory + bytes - sizeof seal, sizeof seal);
  return seal;
}

/// Whether it is so on all ranks.
bool agreed(const Ranks& ranks, bool mine) {
  for (const std::string& theirs : gathered(ranks, mine ? "y" : ""))
    if (theirs.empty()) return false;
  return true;
}

}  // namespace

std::shared_ptr<std::byte> shared_memory(const Ranks& ranks, size_t bytes, bool wants) {
  if (ranks.size() == 1 || !ranks.real() || !agreed(ranks, wants)) return nullptr;
  const bool first = ranks.rank() == 0;
  bytes = (bytes + sizeof(Seal) + kHugePage - 1) / kHugePage * kHugePage;
  const File made(first ? new_file(bytes) : -1);
  std::shared_ptr<std::byte> memory = mapped(made, bytes);
  const Seal seal{getpid(), std::chrono::steady_clock::now().time_since_epoch().count()};
  if (first && memory) std::memcpy(memory.get() + bytes - sizeof seal, &seal, sizeof seal);
  const std::vector<int64_t> told = from_first(ranks, {made.number(), seal[0], seal[1]});
  if (!first && told[0] >= 0) {
    memory = mapped(File(opened_file(told[1], told[0], bytes)), bytes);
    if (memory && seal_of(memory.get(), bytes) != Seal{told[1], told[2]}) memory = nullptr;
  }
  return agreed(ranks, memory != nullptr) ? memory : nullptr;
}

}  // namespace cloam
