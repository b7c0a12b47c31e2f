// See command.h.
#include "benchmarks/command.h"

#include <cstdio>
#include <filesystem>
#include <fstream>

#include "benchmarks/report.h"
#include "benchmarks/scaling.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

void write(const fs::path& path, const std::string& content) {
  std::ofstream file(path, std::ios::binary);
  file << content << std::flush;
  if (!file) throw Error(Fault::write, text(path.string(), " cannot be written"));
}

/// docs/performance.md and docs/performance-scaling.svg.
void write_page(const BenchReport& report, const fs::path& path) {
  fs::path plot = path;
  plot.replace_filename(path.stem().string() + "-scaling.svg");
  const auto series = series_of(report.rows);
  if (!series.empty()) write(plot, plot_of(series));
  write(path, page_of(report, plot.filename().string()));
}

}  // namespace

void bench_command(const Workloads& all, const BenchRequest& request) {
  const Workloads chosen = chosen_workloads(all, request.options.patterns);
  const BenchReport report = run_bench(chosen, request.options, [&](const std::string& line) {
    if (!request.quiet) std::fprintf(stderr, "%s\n", line.c_str());
  });
  for (const std::string& note : report.notes) std::fprintf(stderr, "warning: %s\n", note.c_str());
  const std::string out = request.json ? json_of(report) : table_of(report);
  if (std::fwrite(out.data(), 1, out.size(), stdout) != out.size() || std::fflush(stdout) != 0)
    throw Error(Fault::write, "stdout cannot be written");
  if (!request.report.empty()) write_page(report, request.report);
}

}  // namespace cloam
