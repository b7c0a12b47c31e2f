// cloam-benchmarks: what `cloam bench` does with the workloads of the runtime; needs no library but OpenCL.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "benchmarks/command.h"
#include "runtime/device.h"
#include "runtime/error.h"

namespace {

using namespace cloam;

constexpr char kUsage[] =
    "cloam-benchmarks [PART-OF-A-NAME ...] [--peers] [--json] [--rounds N] [--report FILE] [--device D]";

BenchRequest parse(int count, char** words) {
  BenchRequest out;
  for (int i = 1; i < count; i++) {
    const std::string word = words[i];
    const bool more = i + 1 < count;
    if (word == "--peers")
      out.options.peers = true;
    else if (word == "--json")
      out.json = true;
    else if (word == "--rounds" && more)
      out.options.rounds = std::atoi(words[++i]);
    else if (word == "--report" && more)
      out.report = words[++i];
    else if (word == "--device" && more)
      choose_device({.device = words[++i]});
    else if (word.starts_with("-"))
      throw Error(Fault::usage, text("unknown option ", word, "\n  usage: ", kUsage));
    else
      out.options.patterns.push_back(word);
  }
  return out;
}

}  // namespace

int main(int count, char** words) {
  try {
    bench_command(op_workloads(), parse(count, words));
    return 0;
  } catch (const Error& e) {
    std::fprintf(stderr, "error: %s\n", e.what());
    return static_cast<int>(e.fault());
  }
}
