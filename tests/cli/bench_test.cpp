// cloam bench: what it prints, and that peers which are missing or fail cost nothing but their own figures.
#include <doctest/doctest.h>
#include <signal.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <thread>

#include "benchmarks/peers/peer.h"
#include "tests/cli/process.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

/// A folder with peers that are shell scripts.
struct FakePeers {
  fs::path folder;
  explicit FakePeers(const std::string& name) : folder(scratch() / name) { fs::create_directories(folder); }
  void add(const std::string& name, const std::string& at_sample) const {
    const fs::path path = folder / ("cloam-peer-" + name);
    write_text(path,
               "#!/bin/sh\nwhile read -r request work; do\n  case $request in\n    library) echo a library 1.2 ;;\n    "
               "list) echo matmul.512.nn ;;\n" +
                   ("    sample) " + at_sample + " ;;\n  esac\ndone\n"));
    fs::permissions(path, fs::perms::owner_all);
  }
  std::string variable() const { return "CLOAM_PEERS=" + folder.string(); }
};

nlohmann::json json_of(const Outcome& outcome) {
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  return nlohmann::json::parse(outcome.out);
}

const Words kOneProduct = {"bench", "matmul.512.nn", "--peers", "--rounds", "1"};

Words json_product() {
  Words words = kOneProduct;
  words.push_back("--json");
  return words;
}

}  // namespace

TEST_CASE("a peer answers line by line, and keeps the ways of one work together") {
  int prepared = 0;
  const auto work = [&](const std::string& name) {
    return peer::Work{name, [&] {
                        prepared++;
                        return [] {};
                      }};
  };
  const peer::Work broken = {"broken", []() -> peer::Run { throw std::runtime_error("no memory\nin detail"); }};
  peer::Server server("a library 1.2", {work("a"), work("a@other"), work("b"), broken});
  CHECK(server.answer("library") == "a library 1.2");
  CHECK(server.answer("list") == "a a@other b broken");
  for (const char* name : {"a", "a@other", "a", "a@other"})
    CHECK(std::stod(server.answer("sample " + std::string(name))) >= 0);
  CHECK(prepared == 2);
  server.answer("sample b");
  server.answer("sample a");
  CHECK(prepared == 4);
  CHECK(server.answer("sample broken") == "error: no memory");
  CHECK(server.answer("sample c") == "error: no work is called c");
  CHECK(server.answer("hello") == "error: unknown request hello");
  CHECK(peer::fields("conv.3x3.64.b8@channels_last") == std::vector<std::string>{"conv", "3x3", "64", "b8"});
}

TEST_CASE("a pattern that matches nothing names the nearest workloads") {
  const Outcome outcome = cloam_with({"bench", "matmul.521"});
  CHECK(outcome.code == 2);
  CHECK(contains(outcome.err, "no workload has \"matmul.521\" in its name"));
  CHECK(contains(outcome.err, "\n  matmul.512.nn"));
  CHECK(outcome.out.empty());
}

TEST_CASE("a peer that dies is reported with its last words; the others and the row stay") {
  const FakePeers peers("peers-one-dies");
  peers.add("openblas", "echo 5.0");
  peers.add("onednn", "echo the library is broken >&2; exit 3");
  const nlohmann::json json = json_of(cloam_with(json_product(), {peers.variable()}));
  CHECK(json["schema_version"] == 1);
  for (const char* key : {"device", "driver", "platform", "class", "pocl_affinity", "limits", "notes", "rows"})
    CHECK_MESSAGE(json.contains(key), key);
  CHECK(json["limits"]["gflops"].get<double>() > 0);
  REQUIRE(json["rows"].size() == 1);
  const nlohmann::json row = json["rows"][0];
  CHECK(row["name"] == "matmul.512.nn");
  CHECK(row["peer"] == "openblas");
  CHECK(json["peers"]["openblas"] == "a library 1.2");
  CHECK(row["peers"] == nlohmann::json{{"openblas", 5.0}});
  CHECK(row["ratio"].get<double>() == doctest::Approx(5.0 / row["median_ms"].get<double>()).epsilon(1e-3));
  const double gflops = 2.0 * 512 * 512 * 512 / row["median_ms"].get<double>() * 1e-6;
  CHECK(row["gflops"].get<double>() == doctest::Approx(gflops).epsilon(1e-3));
  CHECK(row["launches"].get<double>() >= 1);
  CHECK(contains(json["notes"].dump(), "peer onednn ended with exit code 3"));
  CHECK(contains(json["notes"].dump(), "the library is broken"));
}

TEST_CASE("a peer that is not built is named with its package; the page is written all the same") {
  const fs::path page = scratch() / "performance.md";
  Words words = kOneProduct;
  words.insert(words.end(), {"--report", page.string()});
  const Outcome outcome = cloam_with(words, {FakePeers("no-peers").variable()});
  CHECK(outcome.code == 0);
  CHECK(contains(outcome.err, "peer openblas is not built: apt-get install libopenblas-dev"));
  CHECK(contains(outcome.out, "matmul.512.nn"));
  CHECK(contains(content_of(page), "| `matmul.512.nn` |"));
  CHECK(contains(content_of(page), "no peer here"));
}

TEST_CASE("an interrupted run leaves no peer behind") {
  const FakePeers peers("peers-interrupted");
  const fs::path id_file = peers.folder / "id";
  peers.add("openblas", "echo $$ >" + (peers.folder / "id.part").string() + "; mv " +
                            (peers.folder / "id.part").string() + " " + id_file.string() + "; read -r forever");
  Process process(kOneProduct, {peers.variable()});
  REQUIRE(wait_for(id_file, process));
  process.signal(SIGINT);
  CHECK(process.wait().code != 0);
  const fs::path words = "/proc/" + std::to_string(std::stoi(content_of(id_file))) + "/cmdline";  // empty once it ended
  for (int i = 0; i < 200 && !content_of(words).empty(); i++)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  CHECK(content_of(words).empty());
}

TEST_CASE("files of several devices are compared on one page") {
  const fs::path folder = scratch() / "merged";
  fs::create_directories(folder);
  const auto file = [&](const std::string& name, double first, double second) {
    nlohmann::json bench = {
        {"schema_version", 1}, {"device", "device " + name}, {"driver", "7"}, {"platform", "P"}, {"class", "gpu"}};
    bench["limits"] = {{"gflops", 1000}, {"copy_gbps", 100}, {"launch_us", 5}};
    bench["rows"] = {{{"name", "matmul.512.nn"}, {"median_ms", first}, {"share_of_peak", 0.5}},
                     {{"name", "sort.1m " + name}, {"median_ms", second}, {"share_of_peak", nullptr}}};
    const fs::path path = folder / (name + ".json");
    write_text(path, bench.dump());
    return path.string();
  };
  const std::string a = file("a", 2, 8), b = file("b", 0.5, 1);
  const Outcome page = cloam_with({"bench", "--merge", a, b});
  CHECK_MESSAGE(page.code == 0, page.err);
  CHECK(contains(page.out, "| 2: device b | 7 | P | gpu | 1000 GFLOP/s | 100 GB/s | 5.0 us | 4.00 (1 workload) |"));
  CHECK(contains(page.out, "| `matmul.512.nn` | 2 ms, 50 % | 0.5 ms, 50 % |"));
  CHECK(contains(page.out, "| `sort.1m b` | - | 1 ms |"));
  const fs::path report = folder / "page.md";
  CHECK(cloam_with({"bench", "--merge", a, b, "--report", report.string()}).code == 0);
  CHECK(content_of(report) == page.out);
  for (const std::string& wrong : {std::string("{}"), std::string("[1, 2"),
                                   std::string("{\"schema_version\": 2, "
                                               "\"device\": \"x\", \"rows\": []}"),
                                   std::string("{\"schema_version\": 1, \"device\": \"x\", \"rows\": [{}]}")}) {
    write_text(folder / "wrong.json", wrong);
    const Outcome refused = cloam_with({"bench", "--merge", a, (folder / "wrong.json").string()});
    CHECK_MESSAGE(refused.code == 3, wrong);
    CHECK(contains(refused.err, "wrong.json"));
  }
}

TEST_CASE("a budget that is used up begins no workload, and says what was left out") {
  Words words = {"bench", "--filter", "matmul.512", "--rounds", "1", "--budget", "0.01s", "--json"};
  const nlohmann::json json = json_of(cloam_with(words));
  CHECK(json["rows"].empty());
  CHECK(contains(json["notes"].dump(), "the budget ended before"));
}

TEST_CASE("--require-gpu refuses a CPU") {
  const Outcome refused = cloam_with({"selftest", "--only", "relu", "--require-gpu", "--device", "cpu"});
  CHECK(refused.code == 4);
  CHECK(contains(refused.err, "--require-gpu: the device is a CPU"));
}
