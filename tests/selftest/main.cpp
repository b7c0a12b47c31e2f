// cloam-selftest: every op on a device against float64 on the host. Needs OpenCL and the standard library only.
#include <algorithm>
#include <iomanip>
#include <iostream>

#include "runtime/device.h"
#include "runtime/error.h"
#include "runtime/hash.h"
#include "tests/op_cases/candidates.h"
#include "tests/op_cases/selftest.h"

namespace {

using namespace cloam;

struct Options {
  SelftestWish wish;
  bool json = false, bits = false, help = false;
  std::string device = "auto";
};

Options parse(int count, char** words) {
  Options out;
  for (int i = 1; i < count; i++) {
    const std::string word = words[i];
    if (word == "--quick")
      out.wish.quick = true;
    else if (word == "--json")
      out.json = true;
    else if (word == "--bits")
      out.bits = true;
    else if (word == "--help")
      out.help = true;
    else if (word == "--only" && i + 1 < count)
      out.wish.only.emplace_back(words[++i]);
    else if (word == "--device" && i + 1 < count)
      out.device = words[++i];
    else
      throw Error(Fault::usage,
                  text("unknown option ", word,
                       "\n  fix: cloam-selftest [--quick] [--json | --bits] [--only PART]... [--device D]"));
  }
  return out;
}

/// A number for each row that changes with any bit of its results and gradients (FNV-1a): devices can be compared.
int print_bits() {
  for (const OpCase& row : op_cases()) {
    const std::vector<uint32_t> bits = bits_of(row);
    const uint64_t hash = fnv1a({reinterpret_cast<const char*>(bits.data()), bits.size() * sizeof(uint32_t)});
    std::cout << std::hex << std::setfill('0') << std::setw(16) << hash << "  " << row.name() << std::endl;
  }
  return 0;
}

int run(const Options& options) {
  choose_device({.device = options.device});
  std::cerr << "device " << device().id << "  " << device().name << " (" << device().platform << ")\ndriver "
            << device().driver << ", " << device().cl_version << "\n";
  if (options.bits) return print_bits();
  const auto progress = [&](const SelftestRow& row, size_t, size_t) {
    if (!options.json) print_row(std::cout, row), std::cout.flush();
  };
  const SelftestReport report = run_selftest(options.wish, progress);
  options.json ? print_json(std::cout, report) : print_findings(std::cout, report);
  const auto failed =
      std::count_if(report.rows.begin(), report.rows.end(), [](const SelftestRow& row) { return !row.result.passed; });
  const size_t count = report.rows.size();
  std::cerr << count - static_cast<size_t>(failed) << " of " << count << " rows agree with float64\n";
  return failed ? static_cast<int>(Fault::verification) : 0;
}

}  // namespace

int main(int count, char** words) {
  try {
    const Options options = parse(count, words);
    if (options.help) {
      std::cout << "cloam-selftest [--quick] [--json | --bits] [--only PART]... [--device D]: checks every op of a "
                   "device against float64.\n"
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
