// `cloam doctor` names the cause of each broken set-up, first, and what to do.
#include <doctest/doctest.h>

#include <fstream>

#include "tests/cli/process.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// A machine of the test's own: /etc, /dev and /sys below a folder.
class Machine {
 public:
  explicit Machine(const std::string& name) : root_(scratch() / ("machine-" + name)) {
    fs::create_directories(root_ / "etc/OpenCL/vendors");
    fs::create_directories(root_ / "dev/dri");
    fs::create_directories(root_ / "sys/bus/pci/devices");
  }
  void driver(const std::string& name, const std::string& library) const {
    file("etc/OpenCL/vendors/" + name, library);
  }
  void card(const std::string& vendor) const {
    file("sys/bus/pci/devices/0000:01:00.0/class", "0x030000");
    file("sys/bus/pci/devices/0000:01:00.0/vendor", vendor);
  }
  void file(const std::string& name, const std::string& line) const {
    fs::create_directories((root_ / name).parent_path());
    write_text(root_ / name, line + "\n");
  }
  fs::path at(const std::string& name) const { return root_ / name; }
  std::string variable() const { return "CLOAM_SYSTEM_ROOT=" + root_.string(); }

 private:
  fs::path root_;
};

const std::string kPocl = "libpocl.so.2";

struct Finding {
  std::string what, found, fix;
};

/// The first problem, which must be told as the cause.
Finding first_problem(const Words& environment) {
  const Outcome outcome = cloam_with({"doctor", "--json"}, environment);
  CHECK_MESSAGE(outcome.code == 4, outcome.code, outcome.out, outcome.err);
  const nlohmann::json report = nlohmann::json::parse(outcome.out);
  CHECK(report["healthy"] == false);
  for (const nlohmann::json& one : report["findings"])
    if (!one["ok"]) return {one["what"], one["found"], one["fix"]};
  FAIL("no problem was found: ", outcome.out);
  return {};
}

void check(const Finding& found, const std::string& what, const std::string& cause, const std::string& fix) {
  CHECK_MESSAGE(contains(found.what, what), found.what);
  CHECK_MESSAGE(contains(found.found, cause), found.found);
  CHECK_MESSAGE(contains(found.fix, fix), found.fix);
}

}  // namespace

TEST_CASE("doctor: a machine that works, with words and with --json") {
  const Machine machine("sound");
  machine.driver("pocl.icd", kPocl);
  const Words environment = {machine.variable(), "OCL_ICD_VENDORS=pocl.icd"};
  const Outcome words = cloam_with({"doctor"}, environment);
  CHECK_MESSAGE(words.code == 0, words.out, words.err);
  CHECK(contains(words.out, "ok       driver: pocl.icd (libpocl.so.2)\n"));
  CHECK(contains(words.out, "ok       a kernel that runs: on "));
  CHECK(contains(words.out, "\neverything works\n"));
  const Outcome json = cloam_with({"doctor", "--json"}, environment);
  CHECK(nlohmann::json::parse(json.out)["healthy"] == true);
}

TEST_CASE("doctor: no driver, or one that does not load") {
  const Machine none("none");
  check(first_problem({none.variable(), "OCL_ICD_VENDORS=" + none.at("etc/OpenCL/vendors").string()}), "driver",
        "no file *.icd in ", "unset OCL_ICD_VENDORS; else sudo apt install pocl-opencl-icd");
  const Machine wrong("wrong");
  wrong.driver("old.icd", "libnothing.so.7");
  check(first_problem({wrong.variable(), "OCL_ICD_VENDORS=" + wrong.at("etc/OpenCL/vendors").string()}), "driver",
        "old.icd names libnothing.so.7, which does not load: ", "sudo rm ");
}

TEST_CASE("doctor: a graphics card that nobody may open, that a container hides, or that no driver offers") {
  const Machine machine("card");
  machine.driver("pocl.icd", kPocl);
  machine.card("0x1002");
  const Words environment = {machine.variable(), "OCL_ICD_VENDORS=pocl.icd", "RUSTICL_ENABLE="};
  check(first_problem(environment), "graphics card of AMD", "it is on the PCI bus, but there is no ",
        "docker run --device /dev/dri");
  // A link to nowhere cannot be opened even by root.
  fs::create_symlink("/nonexistent", machine.at("dev/dri/renderD128"));
  check(first_problem(environment), "graphics card of AMD", "renderD128 may not be opened by this user",
        "sudo usermod -aG render,video $USER");
  fs::remove(machine.at("dev/dri/renderD128"));
  machine.file("dev/dri/renderD128", "");
  check(first_problem(environment), "graphics card of AMD",
        "no OpenCL driver offers it; these variables may hide it: ", "mesa-opencl-icd");
}

TEST_CASE("doctor: a folder of compiled kernels that cannot be written") {
  const Machine machine("cache");
  machine.driver("pocl.icd", kPocl);
  write_text(scratch() / "a-file", "");
  check(first_problem(
            {machine.variable(), "OCL_ICD_VENDORS=pocl.icd", "POCL_CACHE_DIR=" + (scratch() / "a-file").string()}),
        "compiled kernels", (scratch() / "a-file").string(), "export POCL_CACHE_DIR=FOLDER");
}

TEST_CASE("doctor: a driver that is too old, a device with too little memory") {
  const Machine machine("small");
  machine.driver("pocl.icd", kPocl);
  Words environment = {machine.variable(), "OCL_ICD_VENDORS=pocl.icd", "OPENCL_LAYERS=" CLOAM_LAYER_LIBRARY,
                       "CLOAM_LAYER=profile=amd,version=1.1"};
  check(first_problem(environment), "device 0:0", "is too old: OpenCL 1.1", "update the driver");
  environment.back() = "CLOAM_LAYER=profile=amd,memory=256";
  check(first_problem(environment), "device 0:0", "too little memory: 256 MB, ", "close other programs");
}

TEST_CASE("doctor: PoCL without the linker that it starts") {
  const Machine machine("linker");
  machine.driver("pocl.icd", kPocl);
  fs::create_directories(machine.at("cache"));
  check(first_problem({machine.variable(), "OCL_ICD_VENDORS=pocl.icd", "PATH=/nonexistent",
                       "POCL_CACHE_DIR=" + machine.at("cache").string()}),
        "linker", "no ld in PATH", "sudo apt install binutils");
}

TEST_CASE("a command that finds no linker for PoCL says so before a kernel may end it") {
  const Words render = {"render", small_run().string(), "-o", (scratch() / "ld").string(), "--frames", "1", "--path",
                        "orbit"};
  const std::string told = "no ld in PATH, with which Portable Computing Language links kernels";
  const Outcome with = cloam_with(render);
  CHECK(with.code == 0);
  CHECK(!contains(with.err, told));
  CHECK(contains(cloam_with(render, {"PATH=/nonexistent"}).err, told));
}

TEST_CASE("doctor: two drivers for one device") {
  const Machine machine("twice");
  machine.driver("pocl.icd", kPocl);
  machine.driver("pocl-copy.icd", kPocl);
  check(first_problem({machine.variable(), "OCL_ICD_VENDORS=" + machine.at("etc/OpenCL/vendors").string()}), "driver",
        "name the same library: two drivers for one device", "sudo rm ");
}
