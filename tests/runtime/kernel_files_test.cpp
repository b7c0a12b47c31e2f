// Compiled kernels that are no longer whole: which are looked at again. kernel_cache_test.cpp of tests/cli has PoCL's
// own.
#include "runtime/kernel_files.h"

#include <doctest/doctest.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <string>

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// A program with one kernel whose file is cut off, as PoCL lays them out.
fs::path damaged_program(const fs::path& folder, char letter) {
  const fs::path program = folder / "AB" / std::string(37, letter), sizes = program / "scale" / "64-1-1";
  fs::create_directories(sizes);
  std::ofstream(sizes / "scale.so") << "\177EL";
  return program;
}

}  // namespace

TEST_CASE("kernels that are cut off are removed once; after a check those alone that changed since") {
  const fs::path folder = fs::temp_directory_path() / ("cloam-kernel-files-" + std::to_string(::getpid()));
  const fs::path first = damaged_program(folder, 'A');
  CHECK(remove_damaged_kernels(folder) == 1);
  CHECK(!fs::exists(first));
  const fs::path second = damaged_program(folder, 'B');
  fs::last_write_time(folder / "cloam-checked", fs::file_time_type::clock::now() + std::chrono::hours(1));
  CHECK(remove_damaged_kernels(folder) == 0);
  CHECK(fs::exists(second));
  CHECK(remove_damaged_kernels(folder) == 1);  // the last check was noted for now
  CHECK(!fs::exists(second));
  fs::remove_all(folder);
}
