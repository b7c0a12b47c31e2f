#include "cli/doctor_checks.h"

#include <dlfcn.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>

#include "cli/child_program.h"
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr char kInstall[] =
    "sudo apt install pocl-opencl-icd (any CPU), mesa-opencl-icd (AMD and Intel GPUs, with RUSTICL_ENABLE=radeonsi or "
    "iris), intel-opencl-icd (Intel GPUs), nvidia-opencl-icd (NVIDIA GPUs)";

std::string first_line(const fs::path& path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  while (!line.empty() && std::isspace(static_cast<unsigned char>(line.back()))) line.pop_back();
  return line;
}

/// As ocl-icd reads $OCL_ICD_VENDORS: a folder, a file, or the name of a file of the usual folder.
struct Place {
  fs::path folder;
  std::string file;  // empty: all
};
Place place_of_drivers() {
  const fs::path usual = system_path("/etc/OpenCL/vendors");
  const char* given = std::getenv("OCL_ICD_VENDORS");
  if (!given || !*given) return {usual, ""};
  const fs::path named = given;
  if (named.extension() != ".icd") return {named, ""};
  return {named.has_parent_path() ? named.parent_path() : usual, named.filename()};
}

std::vector<fs::path> driver_files(const Place& place) {
  std::vector<fs::path> files;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(place.folder, none))
    if (entry.path().extension() == ".icd" && (place.file.empty() || entry.path().filename() == place.file))
      files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files;
}

Finding driver(const fs::path& file) {
  const std::string library = first_line(file);
  const std::string unset = std::getenv("OCL_ICD_VENDORS") ? ", or unset OCL_ICD_VENDORS" : "";
  if (access(file.c_str(), R_OK) != 0)
    return {Finding::problem, "driver", file.string() + " cannot be read", "sudo chmod a+r " + file.string()};
  if (library.empty())
    return {Finding::problem, "driver", file.string() + " names no library", "sudo rm " + file.string() + unset};
  if (!dlopen(library.c_str(), RTLD_LAZY | RTLD_LOCAL)) {
    const char* const why = dlerror();
    return {Finding::problem, "driver",
            text(file.string(), " names ", library, ", which does not load: ", why ? why : "no reason given"),
            text("install the package that it belongs to again (dpkg -S ", file.string(), "), or sudo rm ",
                 file.string(), unset)};
  }
  return {Finding::fine, "driver", text(file.filename().string(), " (", library, ")"), ""};
}

struct Vendor {
  const char* number;  // on the PCI bus
  const char* name;
  std::vector<const char*> nodes;  // in /dev: what its drivers open, up to the last letters
  const char* install;
};
const std::vector<Vendor>& vendors() {
  static const std::vector<Vendor> all = {
      {"0x1002",
       "AMD",
       {"dri/renderD"},
       "sudo apt install mesa-opencl-icd (Mesa 23.1 or newer: Debian 13, not Debian 12 or its backports) and export "
       "RUSTICL_ENABLE=radeonsi, or install ROCm"},
      {"0x8086", "Intel", {"dri/renderD"}, "sudo apt install intel-opencl-icd"},
      {"0x10de", "NVIDIA", {"nvidiactl", "nvidia0"}, "sudo apt install nvidia-driver nvidia-opencl-icd"}};
  return all;
}

/// The vendors of graphics cards (PCI class 0x03), each once.
std::vector<Vendor> cards() {
  std::vector<Vendor> found;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(system_path("/sys/bus/pci/devices"), none)) {
    if (!first_line(entry.path() / "class").starts_with("0x03")) continue;
    for (const Vendor& vendor : vendors())
      if (first_line(entry.path() / "vendor") == vendor.number &&
          std::none_of(found.begin(), found.end(), [&](const Vendor& v) { return v.name == vendor.name; }))
        found.push_back(vendor);
  }
  return found;
}

std::vector<fs::path> nodes_of(const Vendor& vendor) {
  std::vector<fs::path> found;
  for (const char* node : vendor.nodes) {
    const fs::path like = system_path(std::string("/dev/") + node);
    std::error_code none;
    for (const auto& entry : fs::directory_iterator(like.parent_path(), none))
      if (entry.path().filename().string().starts_with(like.filename().string())) found.push_back(entry.path());
  }
  return found;
}

std::string hiding_variables() {
  std::string out;
  for (const char* name : {"CUDA_VISIBLE_DEVICES", "ROCR_VISIBLE_DEVICES", "HIP_VISIBLE_DEVICES", "GPU_DEVICE_ORDINAL",
                           "ZE_AFFINITY_MASK", "RUSTICL_ENABLE", "POCL_DEVICES", "OCL_ICD_VENDORS"})
    if (const char* value = std::getenv(name)) out += text(out.empty() ? "" : ", ", name, "=", value);
  return out;
}

bool any_gpu(const std::vector<DeviceInfo>& devices) {
  return std::any_of(devices.begin(), devices.end(), [](const DeviceInfo& d) { return !d.is_cpu; });
}

Finding card(const Vendor& vendor, bool gpu_found) {
  const std::string what = text("graphics card of ", vendor.name);
  const std::vector<fs::path> nodes = nodes_of(vendor);
  if (nodes.empty())
    return {Finding::problem, what,
            text("it is on the PCI bus, but there is no ", system_path("/dev/"), vendor.nodes.front(), "*"),
            std::string(vendor.name) == "NVIDIA"
                ? "in a container: docker run --gpus all; else install the driver: sudo apt install nvidia-driver"
                : "in a container: docker run --device /dev/dri; else load the kernel's driver (dmesg | grep drm)"};
  for (const fs::path& node : nodes)
    if (access(node.c_str(), R_OK | W_OK) != 0)
      return {Finding::problem, what, node.string() + " may not be opened by this user",
              "sudo usermod -aG render,video $USER, then log in again"};
  if (!gpu_found) {
    const std::string hiding = hiding_variables();
    return {Finding::problem, what,
            text("no OpenCL driver offers it", hiding.empty() ? "" : "; these variables may hide it: " + hiding),
            hiding.empty() ? vendor.install : text("unset them, or ", vendor.install)};
  }
  return {Finding::fine, what, nodes.front().string() + " can be opened", ""};
}

/// "OpenCL 1.2 ..." as 12.
int version_of(const DeviceInfo& info) {
  const size_t at = info.cl_version.find_first_of("0123456789");
  if (at == std::string::npos || at + 2 >= info.cl_version.size()) return 0;
  return (info.cl_version[at] - '0') * 10 + (info.cl_version[at + 2] - '0');
}

Finding device_finding(const DeviceInfo& info) {
  const std::string what = text("device ", info.id, ", ", info.name, " (", info.platform, ")");
  const std::string other = "select another device (cloam info lists them)";
  if (version_of(info) < 12)
    return {Finding::problem, what,
            text("its driver ", info.driver, " is too old: ", info.cl_version, ", needed is 1.2"),
            "update the driver, or " + other};
  if (info.local_bytes < uint64_t{32} << 10 || info.max_work_group < 64)
    return {Finding::problem, what,
            text("too small: ", words_for_bytes(info.local_bytes), " of local memory and groups of ",
                 info.max_work_group, ", needed are 32 KB and 64"),
            other};
  if (info.global_bytes < uint64_t{512} << 20 || info.max_alloc_bytes < uint64_t{64} << 20)
    return {Finding::problem, what,
            text("too little memory: ", words_for_bytes(info.global_bytes), ", in one piece ",
                 words_for_bytes(info.max_alloc_bytes), "; needed are 512 MB and 64 MB"),
            "close other programs, give the machine more memory, or " + other};
  return {Finding::fine, what, text("driver ", info.driver, ", ", info.cl_version), ""};
}

}  // namespace

std::string system_path(const std::string& path) {
  const char* root = std::getenv("CLOAM_SYSTEM_ROOT");
  return root ? root + path : path;
}

Findings check_drivers() {
  const Place place = place_of_drivers();
  Findings found;
  std::map<std::string, fs::path> by_library;
  for (const fs::path& file : driver_files(place)) {
    found.push_back(driver(file));
    if (found.back().state != Finding::fine) continue;
    const auto [first, fresh] = by_library.emplace(first_line(file), file);
    if (!fresh)
      found.push_back(
          {Finding::problem, "driver",
           text(first->second.string(), " and ", file.string(), " name the same library: two drivers for one device"),
           "sudo rm " + file.string()});
  }
  if (!found.empty()) return found;
  const std::string where = place.file.empty() ? "no file *.icd in " + place.folder.string()
                                               : "no file " + (place.folder / place.file).string();
  const bool moved = std::getenv("OCL_ICD_VENDORS") != nullptr;
  return {{Finding::problem, "driver", where + ": no OpenCL driver is installed there",
           moved ? text("unset OCL_ICD_VENDORS; else ", kInstall) : kInstall}};
}

Findings check_cards(const std::vector<DeviceInfo>& devices) {
  Findings found;
  for (const Vendor& vendor : cards()) found.push_back(card(vendor, any_gpu(devices)));
  return found;
}

Findings check_devices(const std::vector<DeviceInfo>& devices) {
  Findings found;
  for (const DeviceInfo& info : devices) found.push_back(device_finding(info));
  for (size_t i = 0; i < devices.size(); i++)
    for (size_t j = 0; j < i; j++)
      if (devices[i].name == devices[j].name && devices[i].platform != devices[j].platform)
        found.push_back(
            {Finding::problem, "device " + devices[i].name,
             text("two drivers offer it: ", devices[j].platform, " and ", devices[i].platform),
             text("name the one to use with --device ", devices[j].id, " or ", devices[i].id, ", or remove a driver")});
  return found;
}

Findings check_linker(const std::vector<DeviceInfo>& devices) {
  const auto pocl = std::find_if(devices.begin(), devices.end(), [](const DeviceInfo& d) {
    return d.is_cpu && d.platform == "Portable Computing Language";
  });
  if (pocl == devices.end() || !find_program("ld").empty()) return {};
  const ChildEnd end =
      run_child({"/proc/self/exe", {"selftest", "-q", "--only", "matmul", "--device", pocl->id}, {"CLOAM_TUNE=off"}});
  if (end.code >= 0) return {};
  return {{Finding::problem, "linker",
           text("no ld in PATH, with which ", pocl->platform,
                " links kernels: the first kernel ends the program with signal ", -end.code),
           "sudo apt install binutils, or add the folder of ld to PATH"}};
}

}  // namespace cloam
