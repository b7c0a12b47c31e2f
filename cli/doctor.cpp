// cloam doctor: why a device is not found or does not work, from the driver's files to a kernel that runs.
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "cli/commands.h"
#include "cli/doctor_checks.h"
#include "models/io/data_cache.h"
#include "runtime/error.h"
#include "runtime/kernel_cache.h"
#include "runtime/ops.h"

namespace cloam {
namespace {

constexpr char kDoctorExamples[] = R"(Find out why an OpenCL device is missing or does not work, and what to do.

Examples:
  cloam doctor
  cloam doctor --device gpu
  cloam doctor --json)";

struct DoctorRequest {};

Finding check_cache() {
  const KernelCache& cache = kernel_cache();
  if (cache.note.empty()) return {Finding::fine, "compiled kernels", "their folder can be written", ""};
  return {Finding::problem, "compiled kernels", cache.note,
          "free the disk, or export POCL_CACHE_DIR=FOLDER with one that this user can write"};
}

/// Nothing is wrong without it: what it would hold is computed anew each time.
Finding tell_kept_data() {
  const fs::path folder = data_cache_folder();
  if (folder.empty()) return {Finding::fine, "kept sweeps", "none are kept (CLOAM_DATA_CACHE=off)", ""};
  const KeptData kept = kept_data();
  return {Finding::fine, "kept sweeps",
          text(folder.string(), ", ", words_for_bytes(kept.bytes), " in ", kept.files, " files"), ""};
}

/// 64 ones times 64 ones, summed: 64 in each of 4,096 places.
Finding check_kernel(const Common& common) {
  const auto failed = [](const std::string& found) {
    return Finding{Finding::problem, "a kernel that runs", found, "what is said above; else cloam selftest --report"};
  };
  try {
    open_any_device(common);
    const Tensor ones = from_host(std::vector<float>(4096, 1.f), {64, 64});
    const float sum_of_all = sum(matmul(ones, ones)).item();
    if (sum_of_all != 64.f * 4096.f)
      return failed(text("a product of matrices gave ", sum_of_all, ", want ", 64 * 4096));
    return {Finding::fine, "a kernel that runs", "on " + device().name, ""};
  } catch (const Error& error) {
    const std::string message = error.what();
    return failed(message.substr(0, message.find('\n')));
  }
}

/// In the order in which one depends on another: the first problem is the cause of those below it.
Findings examine(const Common& common) {
  Findings all = check_drivers();
  all.push_back(check_cache());
  all.push_back(tell_kept_data());
  std::vector<DeviceInfo> devices;
  try {
    devices = list_devices();
  } catch (const Error&) {}  // the folder of kernels, which was told
  const auto add = [&](const Findings& more) { all.insert(all.end(), more.begin(), more.end()); };
  add(check_cards(devices));
  add(check_devices(devices));
  const Findings linker = check_linker(devices);
  add(linker);
  if (linker.empty()) all.push_back(check_kernel(common));
  return all;
}

void put_findings(const Findings& all) {
  for (const Finding& one : all) {
    put(fmt::format("{:<8} {}: {}\n", one.state == Finding::fine ? "ok" : "PROBLEM", one.what, one.found));
    if (!one.fix.empty()) put(fmt::format("         fix: {}\n", one.fix));
  }
}

void put_report(const Findings& all, bool healthy) {
  nlohmann::ordered_json json = {{"schema_version", 1}, {"healthy", healthy}};
  json["findings"] = nlohmann::ordered_json::array();
  for (const Finding& one : all)
    json["findings"].push_back(
        {{"ok", one.state == Finding::fine}, {"what", one.what}, {"found", one.found}, {"fix", one.fix}});
  put_json(json, 2);
}

int run_doctor(const DoctorRequest&, const Common& common) {
  const Findings all = examine(common);
  const auto problems =
      std::count_if(all.begin(), all.end(), [](const Finding& one) { return one.state == Finding::problem; });
  if (common.json)
    put_report(all, problems == 0);
  else
    put_findings(all);
  if (!common.json)
    put(problems == 0 ? "everything works\n"
                      : fmt::format("{} problem{}; the first is the likely cause of the others\n", problems,
                                    problems == 1 ? "" : "s"));
  return problems == 0 ? 0 : static_cast<int>(Fault::device);
}

}  // namespace

Command add_doctor(CLI::App& program) {
  return command<DoctorRequest>(program, "doctor", kDoctorExamples, run_doctor, [](const Options&, DoctorRequest&) {});
}

}  // namespace cloam
