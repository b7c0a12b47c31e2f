// cloam info: devices, which one runs and how to name it again; what a bug report needs.
#include <fmt/format.h>

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <optional>

#include "cli/commands.h"
#include "runtime/error.h"
#include "runtime/verdict.h"

namespace cloam {
namespace {

using Report = nlohmann::ordered_json;

constexpr char kInfoExamples[] = R"(Show the OpenCL devices and which one is used.

Examples:
  cloam info
  cloam info --json
  cloam info --device gpu)";

constexpr uint64_t kNeededLocalBytes = 32 << 10;
constexpr int kNeededWorkGroup = 64;
const char* const kVariables[] = {"CLOAM_DEVICE",   "CLOAM_DEVICE_CLASS", "CLOAM_DEBUG",    "CLOAM_KERNEL_DIR",
                                  "CLOAM_VARIANT",  "OCL_ICD_VENDORS",    "POCL_CACHE_DIR", "POCL_MAX_PTHREAD_COUNT",
                                  "RUSTICL_ENABLE", "POCL_MEMORY_LIMIT",  "POCL_DEVICES",   "POCL_EXTRA_BUILD_FLAGS",
                                  "NO_COLOR"};

/// From limits, and what selftest found if it ran here.
std::string verdict(const DeviceInfo& info) {
  if (info.local_bytes < kNeededLocalBytes || info.max_work_group < kNeededWorkGroup) return "too small";
  std::string notes;
  if (info.name.find("llvmpipe") != std::string::npos) notes += "  slow (software renderer)";
  if (info.local_bytes <= (32 << 10)) notes += text("  local memory ", info.local_bytes >> 10, " KiB");
  const std::optional<Verdict> tested = verdict_of(info);
  return (tested && !tested->passed() ? "WRONG RESULTS, " : "ok, ") + words_of(tested) + notes;
}

/// The device that a command would take; none (with the reason) if it cannot be chosen.
std::optional<DeviceInfo> chosen_device(const Common& common, std::optional<Error>& why_not) {
  try {
    open_any_device(common);
    return device();
  } catch (const Error& error) {
    why_not = error;
    return std::nullopt;
  }
}

std::string row(const DeviceInfo& info, bool chosen) {
  return fmt::format("{} {:<5} {:<44.44} {:<4} {:>9}  {:>5}  {}\n", chosen ? "*" : " ", info.id,
                     info.name + " (" + info.platform + ")", info.is_cpu ? "cpu" : "gpu",
                     words_for_bytes(info.global_bytes), info.compute_units, verdict(info));
}

std::string environment() {
  std::string out;
  for (const char* name : kVariables) {
    if (const char* value = std::getenv(name)) out += text(" ", name, "=", value);
  }
  return out.empty() ? " nothing set" : out;
}

void put_table(const std::vector<DeviceInfo>& devices, const std::optional<DeviceInfo>& chosen) {
  std::string out =
      fmt::format("  {:<5} {:<44} {:<4} {:>9}  {:>5}  {}\n", "id", "device", "type", "memory", "units", "verdict");
  for (const DeviceInfo& info : devices) out += row(info, chosen && chosen->id == info.id);
  if (chosen) {
    out += text("selected: ", chosen->id, " (",
                chosen->is_cpu ? "no GPU was found, or the CPU was asked for" : "a GPU is preferred over a CPU",
                "); to select it explicitly: ", device_spelling(*chosen), "\n");
    out += "memory budget " + words_for_bytes(memory_budget()) + " (--max-memory changes it), driver " +
           chosen->driver + ", " + chosen->cl_version + "\n";
  }
  out += text("version ", kVersion, ", gcc ", __VERSION__, "; environment:", environment(), "\n");
  if (chosen) out += "cloam selftest --quick checks that the device computes correctly\n";
  put(out);
}

Report selftest_of(const DeviceInfo& info) {
  const std::optional<Verdict> tested = verdict_of(info);
  if (!tested) return nullptr;
  Report off = Report::array();
  for (const SwitchedOff& one : tested->off) off.push_back(one.family);
  return {{"passed", tested->passed()}, {"when", tested->when},     {"quick", tested->quick},
          {"rows", tested->rows},       {"failed", tested->failed}, {"switched_off", off}};
}

Report to_json(const DeviceInfo& info) {
  return {{"id", info.id},
          {"name", info.name},
          {"platform", info.platform},
          {"driver", info.driver},
          {"cl_version", info.cl_version},
          {"type", info.is_cpu ? "cpu" : "gpu"},
          {"class", info.device_class == DeviceClass::cpu ? "cpu" : "gpu"},
          {"global_bytes", info.global_bytes},
          {"max_alloc_bytes", info.max_alloc_bytes},
          {"local_bytes", info.local_bytes},
          {"compute_units", info.compute_units},
          {"max_work_group", info.max_work_group},
          {"verdict", verdict(info)},
          {"selftest", selftest_of(info)}};
}

void put_report(const std::vector<DeviceInfo>& devices, const std::optional<DeviceInfo>& chosen) {
  Report json = {{"schema_version", 1}, {"version", kVersion}, {"default", nullptr}, {"memory_budget_bytes", nullptr}};
  if (chosen) json["default"] = chosen->id;
  if (chosen) json["memory_budget_bytes"] = memory_budget();
  json["devices"] = Report::array();
  for (const DeviceInfo& info : devices) json["devices"].push_back(to_json(info));
  json["environment"] = Report::object();
  for (const char* name : kVariables) {
    if (const char* value = std::getenv(name)) json["environment"][name] = value;
  }
  put_json(json, 2);
}

struct InfoRequest {};

int run_info(const InfoRequest&, const Common& common) {
  const std::vector<DeviceInfo> devices = list_devices();
  std::optional<Error> why_not;
  const std::optional<DeviceInfo> chosen = chosen_device(common, why_not);
  if (common.json)
    put_report(devices, chosen);
  else
    put_table(devices, chosen);
  if (why_not) throw Error(*why_not);
  return 0;
}

}  // namespace

Command add_info(CLI::App& program) {
  return command<InfoRequest>(program, "info", kInfoExamples, run_info, [](const Options&, InfoRequest&) {});
}

}  // namespace cloam
