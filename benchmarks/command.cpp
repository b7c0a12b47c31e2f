// See command.h.
#include "benchmarks/command.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <system_error>

#include "benchmarks/report.h"
#include "benchmarks/scaling.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

/// Whole or not at all. models/io/commit.h is not linked here: cloam-benchmarks needs the runtime alone.
void write(const fs::path& path, const std::string& content) {
  const fs::path fresh = path.string() + ".new";
  std::error_code problem;
  errno = 0;
  std::ofstream file(fresh, std::ios::binary);
  file << content;
  file.close();
  if (!file) problem.assign(errno, std::generic_category());
  if (file) fs::rename(fresh, path, problem);
  if (file && !problem) return;
  std::error_code ignored;
  fs::remove(fresh, ignored);
  throw Error(Fault::write, text("cannot write ", path.string(), ": ", problem.message()));
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
    throw Error(Fault::write, text("cannot write to standard output: ", std::strerror(errno)));
  if (!request.report.empty()) write_page(report, request.report);
}

}  // namespace cloam
