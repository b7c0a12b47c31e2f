// cloam-selftest: every op on a device against float64 on the host. Needs OpenCL and the standard library only.
#include <algorithm>
#include <iomanip>
#include <iostream>

#include "runtime/device.h"
#include "runtime/error.h"
#include "tests/op_cases/candidates.h"
#include "tests/op_cases/selftest.h"

namespace {

using namespace cloam;

struct Options {
  bool quick = false, json = false, bits = false, help = false;
  std::string device = "auto";
};

Options parse(int count, char** words) {
  Options out;
  for (int i = 1; i < count; i++) {
    const std::string word = words[i];
    if (word == "--quick")
      out.quick = true;
    else if (word == "--json")
      out.json = true;
    else if (word == "--bits")
      out.bits = true;
    else if (word == "--help")
      out.help = true;
    else if (word == "--device" && i + 1 < count)
      out.device = words[++i];
    else
      throw Error(Fault::usage,
                  text("unknown option ", word, "\n  fix: cloam-selftest [--quick] [--json | --bits] [--device D]"));
  }
  return out;
}

/// A number for each row that changes with any bit of its results and gradients (FNV-1a): devices can be compared.
int print_bits() {
  for (const OpCase& row : op_cases()) {
    uint64_t hash = 1469598103934665603ull;
    for (const uint32_t bits : bits_of(row))
      for (int shift = 0; shift < 32; shift += 8) hash = (hash ^ (bits >> shift & 255)) * 1099511628211ull;
    std::cout << std::hex << std::setfill('0') << std::setw(16) << hash << "  " << row.name() << std::endl;
  }
  return 0;
}

int run(const Options& options) {
  choose_device({.device = options.device});
  std::cerr << "device " << device().id << "  " << device().name << " (" << device().platform << ")\n";
  if (options.bits) return print_bits();
  const auto progress = [&](const SelftestRow& row, size_t, size_t) {
    if (!options.json) print_row(std::cout, row), std::cout.flush();
  };
  const std::vector<SelftestRow> rows = run_selftest(options.quick, progress);
  if (options.json) print_json(std::cout, rows);
  const auto failed =
      std::count_if(rows.begin(), rows.end(), [](const SelftestRow& row) { return !row.result.passed; });
  std::cerr << rows.size() - static_cast<size_t>(failed) << " of " << rows.size() << " rows agree with float64\n";
  return failed ? static_cast<int>(Fault::verification) : 0;
}

}  // namespace

int main(int count, char** words) {
  try {
    const Options options = parse(count, words);
    if (options.help) {
      std::cout
          << "cloam-selftest [--quick] [--json | --bits] [--device D]: checks every op of a device against float64.\n"
             "--bits prints a number for each op that changes with any bit of its results, and checks nothing.\n"
             "Exit codes: 0 all agree, 4 no device, 7 an op differs.\n";
      return 0;
    }
    return run(options);
  } catch (const Error& error) {
    std::cerr << "error: " << error.what() << "\n";
    return static_cast<int>(error.fault());
  } catch (const std::exception& error) {
    std::cerr << "error: " << error.what() << "\n";
    return 1;
  }
}
