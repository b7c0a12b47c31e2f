// Files that matter: whole or not at all, each changed bit found, hostile headers refused.
#include <doctest/doctest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstring>
#include <fstream>
#include <limits>
#include <span>
#include <string>

#include "models/io/checkpoint.h"
#include "models/io/commit.h"
#include "models/io/crc32c.h"
#include "models/io/safetensors.h"
#include "runtime/error.h"
#include "tests/models/folder.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

void spoil(const fs::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary | std::ios::trunc)
      .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

template <class Value>
NamedTensor tensor(std::string dtype, std::vector<int64_t> shape, const std::vector<Value>& values) {
  const auto bytes = std::as_bytes(std::span(values));
  return {std::move(dtype), std::move(shape), {bytes.begin(), bytes.end()}};
}

SafetensorsFile sample() {
  SafetensorsFile file;
  file.tensors["field.weight"] = tensor<float>("F32", {2, 3}, {1, -2, 3.5F, 0, 5, -6});
  file.tensors["steps"] = tensor<int64_t>("I64", {}, {123456789012});
  file.tensors["mask"] = tensor<uint8_t>("U8", {3}, {0, 128, 255});
  file.tensors["none"] = tensor<float>("F32", {0, 4}, {});
  file.metadata["method"] = "nerf \"quoted\" \n";
  return file;
}

template <class Action>
Error error_of(const Action& action) {
  try {
    action();
  } catch (const Error& problem) { return problem; }
  FAIL("no error");
  return Error(Fault::internal, "");
}

bool says(const Error& problem, const std::string& part) {
  const bool found = std::string(problem.what()).find(part) != std::string::npos;
  if (!found) MESSAGE("message: ", problem.what());
  return found;
}

/// The bytes of a file with this header and that many zero bytes of data.
std::string with_header(const std::string& header, size_t data) {
  const uint64_t length = header.size();
  std::string bytes(8, '\0');
  std::memcpy(bytes.data(), &length, 8);
  return bytes + header + std::string(data, '\0');
}

}  // namespace

TEST_CASE("commit: a file is replaced as a whole and leaves no litter") {
  const Folder folder;
  const fs::path path = folder.path / "new" / "note.txt";
  commit_text(path, "first");
  commit_text(path, "second, longer");
  CHECK(content_of(path) == "second, longer");
  CHECK(std::distance(fs::directory_iterator(path.parent_path()), fs::directory_iterator()) == 1);
}

TEST_CASE("commit: a failing writer leaves the old file and no temporary one") {
  const Folder folder;
  const fs::path path = folder.path / "picture.png";
  commit_text(path, "old");
  const auto half_written = [&](const fs::path& temp) {
    CHECK(temp.parent_path() == folder.path);
    CHECK(temp.extension() == ".png");
    spoil(temp, "half");
    throw std::runtime_error("the encoder gave up");
  };
  const Error problem = error_of([&] { commit_file(path, half_written); });
  CHECK(problem.fault() == Fault::write);
  CHECK(says(problem, path.string()));
  CHECK(says(problem, "the encoder gave up"));
  CHECK(content_of(path) == "old");
  CHECK(files_in(folder.path) == 1);
}

TEST_CASE("commit: an error of the writer keeps its own fault") {
  const Folder folder;
  const auto diverge = [](const fs::path&) { throw Error(Fault::diverged, "NaN"); };
  CHECK(error_of([&] { commit_file(folder.path / "x", diverge); }).fault() == Fault::diverged);
}

TEST_CASE("commit: what the disk refuses is a write fault with the reason") {
  const Folder folder;
  fs::create_directory(folder.path / "taken");
  spoil(folder.path / "taken" / "inside", "x");
  const Error directory = error_of([&] { commit_text(folder.path / "taken", "x"); });
  CHECK(directory.fault() == Fault::write);
  CHECK(says(directory, std::strerror(EISDIR)));
  CHECK(files_in(folder.path) == 1);
  spoil(folder.path / "file", "x");
  CHECK(error_of([&] { commit_text(folder.path / "file" / "below", "x"); }).fault() == Fault::write);
}

TEST_CASE("commit: no room for the bytes says how many are needed and leaves the old file") {
  const Folder folder;
  commit_text(folder.path / "x", "old");
  // A limit on the size of files refuses the second part of a write, just where a full disk does.
  const auto previous_action = std::signal(SIGXFSZ, SIG_IGN);
  rlimit previous{};
  getrlimit(RLIMIT_FSIZE, &previous);
  rlimit small = previous;
  small.rlim_cur = 4096;
  setrlimit(RLIMIT_FSIZE, &small);
  const Error problem = error_of([&] { commit_text(folder.path / "x", std::string(10'000, 'x')); });
  setrlimit(RLIMIT_FSIZE, &previous);
  std::signal(SIGXFSZ, previous_action);
  CHECK(problem.fault() == Fault::write);
  CHECK(says(problem, "needs 10000 bytes"));
  CHECK(content_of(folder.path / "x") == "old");
  CHECK(files_in(folder.path) == 1);
}

TEST_CASE("commit: temporary files of dead writers are removed, of living ones kept") {
  const Folder folder;
  const pid_t child = fork();
  if (child == 0) _exit(0);
  waitpid(child, nullptr, 0);
  spoil(folder.path / text(".a.tmp-", child, "-0.png"), "dead");
  spoil(folder.path / text(".a.tmp-", getpid(), "-0.png"), "alive");
  spoil(folder.path / "a.tmp-1.png", "no temporary file");
  remove_stale_temporaries(folder.path);
  CHECK(files_in(folder.path) == 2);
}

TEST_CASE("lock: the second holder is refused with the process id of the first; a dead holder holds nothing") {
  const Folder folder;
  {
    const FolderLock first(folder.path);
    const Error problem = error_of([&] { FolderLock second(folder.path); });
    CHECK(problem.fault() == Fault::usage);
    CHECK(says(problem, std::to_string(getpid())));
  }
  CHECK(files_in(folder.path) == 0);
  const pid_t child = fork();
  if (child == 0) {
    const FolderLock held(folder.path);
    _exit(0);  // without the destructor, as a kill would
  }
  waitpid(child, nullptr, 0);
  CHECK(files_in(folder.path) == 1);
  CHECK_NOTHROW(FolderLock(folder.path));
}

TEST_CASE("crc32c: known answers of RFC 3720, whole and in parts") {
  std::vector<std::byte> bytes(32, std::byte{0});
  CHECK(crc32c(bytes) == 0x8a9136aa);
  for (size_t i = 0; i < 32; ++i) bytes[i] = static_cast<std::byte>(i);
  CHECK(crc32c(bytes) == 0x46dd794e);
  const std::span<const std::byte> all(bytes);
  CHECK(crc32c(all.subspan(5), crc32c(all.first(5))) == 0x46dd794e);
  CHECK(crc32c_digits(0x0a9136aa) == "0a9136aa");
}

TEST_CASE("safetensors: what is written is read back, and the bytes depend on the contents alone") {
  const Folder folder;
  write_safetensors(folder.path / "a", sample());
  write_safetensors(folder.path / "b", read_safetensors(folder.path / "a"));
  CHECK(read_safetensors(folder.path / "a") == sample());
  CHECK(content_of(folder.path / "a") == content_of(folder.path / "b"));
}

TEST_CASE("safetensors: a file that holds anything else is told from what it should hold") {
  const Folder folder;
  const fs::path path = folder.path / "a";
  write_safetensors(path, sample());
  CHECK(reads_back(path, sample()));
  SafetensorsFile other_value = sample(), other_text = sample(), one_more = sample(), one_less = sample(),
                  other_name = sample();
  other_value.tensors["field.weight"].data.back() ^= std::byte{1};
  other_text.metadata["other"] = "";
  one_more.tensors["more"] = tensor<float>("F32", {1}, {1});
  one_less.tensors.erase("field.weight");
  auto moved = other_name.tensors.extract("field.weight");
  moved.key() = "field.weighs";
  other_name.tensors.insert(std::move(moved));
  for (const SafetensorsFile* other : {&other_value, &other_text, &one_more, &one_less, &other_name})
    CHECK_FALSE(reads_back(path, *other));
}

TEST_CASE("safetensors: the file has the published layout") {
  const Folder folder;
  write_safetensors(folder.path / "a", sample());
  const std::string bytes = content_of(folder.path / "a");
  uint64_t length = 0;
  std::memcpy(&length, bytes.data(), 8);
  CHECK(length % 8 == 0);
  const std::string header = bytes.substr(8, length);
  CHECK(header.find(R"("field.weight":{"dtype":"F32","shape":[2,3],"data_offsets":[0,24]})") != std::string::npos);
  float third = 0;
  std::memcpy(&third, bytes.data() + 8 + length + 8, 4);
  CHECK(third == 3.5F);
}

TEST_CASE("safetensors: a file of another writer, without checksums") {
  const Folder folder;
  spoil(folder.path / "a", with_header(R"({"b":{"dtype":"I32","shape":[1],"data_offsets":[4,8]},)"
                                       R"("a":{"data_offsets":[0,4],"dtype":"BF16","shape":[2]}}  )",
                                       8));
  const SafetensorsFile file = read_safetensors(folder.path / "a");
  CHECK(file.tensors.at("a").dtype == "BF16");
  CHECK(file.tensors.at("b").data.size() == 4);
}

TEST_CASE("safetensors: each flipped bit and each truncation is found") {
  const Folder folder;
  const fs::path path = folder.path / "a";
  write_safetensors(path, sample());
  const std::string good = content_of(path);
  size_t missed = 0;
  for (size_t bit = 0; bit < good.size() * 8; ++bit) {
    std::string bad = good;
    bad[bit / 8] = static_cast<char>(bad[bit / 8] ^ (1 << (bit % 8)));
    spoil(path, bad);
    try {
      read_safetensors(path);
      ++missed;
    } catch (const Error& problem) { missed += problem.fault() != Fault::data; }
  }
  CHECK(missed == 0);
  for (size_t size = 0; size < good.size(); ++size) {
    spoil(path, good.substr(0, size));
    CHECK_THROWS_AS(read_safetensors(path), Error);
  }
}

TEST_CASE("safetensors: damaged data names the tensor and the byte") {
  const Folder folder;
  write_safetensors(folder.path / "a", sample());
  std::string bytes = content_of(folder.path / "a");
  bytes.back() = static_cast<char>(bytes.back() ^ 1);
  spoil(folder.path / "a", bytes);
  const Error problem = error_of([&] { read_safetensors(folder.path / "a"); });
  CHECK(problem.fault() == Fault::data);
  CHECK(says(problem, "'steps'"));
  CHECK(says(problem, text("byte ", bytes.size() - 8)));
}

TEST_CASE("safetensors: hostile headers are refused with a reason") {
  struct Case {
    std::string header;
    size_t data;
    std::string reason;
  };
  const std::string deep(1'000'000, '[');
  const std::vector<Case> cases{
      {R"({"a":{"dtype":"U8","shape":[4],"data_offsets":[0,4]},"b":{"dtype":"U8","shape":[3],"data_offsets":[3,6]}})",
       6, "overlap"},
      {R"({"a":{"dtype":"U8","shape":[4],"data_offsets":[0,4]},"b":{"dtype":"U8","shape":[3],"data_offsets":[5,8]}})",
       8, "hole"},
      {R"({"a":{"dtype":"U8","shape":[4],"data_offsets":[1,5]}})", 5, "hole"},
      {R"({"a":{"dtype":"U8","shape":[4],"data_offsets":[0,4]}})", 5, "1 bytes after the last tensor"},
      {R"({"a":{"dtype":"U8","shape":[4],"data_offsets":[0,4]},"a":{"dtype":"U8","shape":[4],"data_offsets":[0,4]}})",
       4, "appears twice"},
      {R"({"a":{"dtype":"U8","dtype":"U8","shape":[4],"data_offsets":[0,4]}})", 4, "appears twice"},
      {R"({"__metadata__":{},"__metadata__":{}})", 0, "appears twice"},
      {R"({"__metadata__":{"x":"1","x":"2"}})", 0, "appears twice"},
      {R"({"__metadata__":{"x":1}})", 0, "the number 1"},
      {R"({"a":{"dtype":"U8","shape":[4],"data_offsets":[4,0]}})", 4, "hole"},
      {R"({"a":{"dtype":"U8","shape":[4],"data_offsets":[0,9]}})", 4, "leave the data section"},
      {R"({"a":{"dtype":"F32","shape":[4611686018427387904,4],"data_offsets":[0,0]}})", 0, "2^64"},
      {R"({"a":{"dtype":"U8","shape":[9223372036854775808],"data_offsets":[0,0]}})", 0, "the size 9223372036854775808"},
      {R"({"a":{"dtype":"F32","shape":[2],"data_offsets":[0,4]}})", 4, "needs 8 bytes"},
      {R"({"a":{"dtype":"U8","shape":[-4],"data_offsets":[0,4]}})", 4, "negative"},
      {R"({"a":{"dtype":"U8","shape":[4.0],"data_offsets":[0,4]}})", 4, "4.0"},
      {R"({"a":{"dtype":"U8","shape":[1e999],"data_offsets":[0,4]}})", 4, "JSON"},
      {R"({"a":{"dtype":"F31","shape":[1],"data_offsets":[0,4]}})", 4, "F31"},
      {R"({"a":{"dtype":"U8","shape":[4]}})", 0, "no data_offsets"},
      {R"({"a":{"dtype":"U8","shape":[4],"data_offsets":[0]}})", 4, "need 2"},
      {R"({"a":{"dtype":"U8","shape":[4],"data_offsets":[0,4],"extra":0}})", 4, "unknown key"},
      {R"({"a":[1,2]})", 0, "an array"},
      {R"({"a":null})", 0, "null"},
      {R"([])", 0, "'{'"},
      {R"({} x)", 0, "JSON"},
      {std::string("{}\0hidden", 9), 0, "NUL"},
      {"{\"a\":" + deep, 0, "nested deeper"},
      {"{\"a\":{\"shape\":" + deep, 0, "nested deeper"},
      {R"({"a":{"shape":[1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1],"dtype":"U8","data_offsets":[0,1]}})", 1, "16 numbers"},
      {R"({"__metadata__":{"crc32c.b":"00000000"}})", 0, "missing tensor 'b'"},
  };
  const Folder folder;
  for (const Case& row : cases) {
    CAPTURE(row.header.substr(0, 120));
    spoil(folder.path / "a", with_header(row.header, row.data));
    const Error problem = error_of([&] { read_safetensors(folder.path / "a"); });
    CHECK(problem.fault() == Fault::data);
    CHECK(says(problem, row.reason));
    CHECK(std::strlen(problem.what()) < 1000);
  }
}

TEST_CASE("safetensors: a header length beyond the file or the cap is refused before memory is asked for") {
  const Folder folder;
  for (const uint64_t length : {uint64_t{1} << 63, uint64_t{100'000'001}, uint64_t{17}}) {
    std::string bytes(24, '{');
    std::memcpy(bytes.data(), &length, 8);
    spoil(folder.path / "a", bytes);
    CHECK(says(error_of([&] { read_safetensors(folder.path / "a"); }), std::to_string(length)));
  }
}

TEST_CASE("safetensors: only regular files are opened, and a pipe does not hang") {
  const Folder folder;
  REQUIRE(mkfifo((folder.path / "pipe").c_str(), 0600) == 0);
  CHECK(says(error_of([&] { read_safetensors(folder.path / "pipe"); }), "regular"));
  CHECK(error_of([&] { read_safetensors(folder.path); }).fault() == Fault::data);
  CHECK(error_of([&] { read_safetensors(folder.path / "absent"); }).fault() == Fault::data);
}

TEST_CASE("safetensors: values that are not finite are not saved") {
  const Folder folder;
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), -std::numeric_limits<float>::infinity()}) {
    SafetensorsFile file = sample();
    file.tensors["field.weight"] = tensor<float>("F32", {2}, {1, bad});
    const Error problem = error_of([&] { write_safetensors(folder.path / "a", file); });
    CHECK(problem.fault() == Fault::diverged);
    CHECK(says(problem, "field.weight"));
    CHECK(files_in(folder.path) == 0);
  }
  SafetensorsFile half;
  half.tensors["h"] = tensor<uint16_t>("F16", {1}, {0x7c00});
  CHECK(error_of([&] { write_safetensors(folder.path / "a", half); }).fault() == Fault::diverged);
}

TEST_CASE("checkpoints: the last three are kept, later ones of a given-up run are not") {
  const Folder folder;
  for (const int64_t step : {10, 20, 30, 40}) save_checkpoint(folder.path, step, sample());
  CHECK_FALSE(fs::exists(folder.path / "000010.safetensors"));
  CHECK(fs::exists(folder.path / "000020.safetensors"));
  CHECK(content_of(folder.path / "latest.txt") == "000040.safetensors\n");
  save_checkpoint(folder.path, 25, sample());
  CHECK_FALSE(fs::exists(folder.path / "000040.safetensors"));
  CHECK(load_latest_checkpoint(folder.path).step == 25);
}

TEST_CASE("checkpoints: a damaged one is passed over with a warning, none left is an error") {
  const Folder folder;
  for (const int64_t step : {10, 20}) save_checkpoint(folder.path, step, sample());
  CHECK(load_latest_checkpoint(folder.path).warning.empty());
  spoil(folder.path / "000020.safetensors", "garbage garbage");
  const LoadedCheckpoint loaded = load_latest_checkpoint(folder.path);
  CHECK(loaded.step == 10);
  CHECK(loaded.file == sample());
  CHECK(loaded.warning.find("000020.safetensors") != std::string::npos);
  spoil(folder.path / "latest.txt", "../../etc/passwd");
  CHECK(load_latest_checkpoint(folder.path).step == 10);
  spoil(folder.path / "000010.safetensors", "");
  const Error problem = error_of([&] { load_latest_checkpoint(folder.path); });
  CHECK(problem.fault() == Fault::data);
  CHECK(says(problem, "found 2 checkpoints"));
  CHECK(says(error_of([&] { load_latest_checkpoint(folder.path / "absent"); }), "no such folder"));
}

TEST_CASE("checkpoints: a diverged save keeps the last good one") {
  const Folder folder;
  save_checkpoint(folder.path, 10, sample());
  SafetensorsFile bad = sample();
  bad.tensors["field.weight"] = tensor<float>("F32", {1}, {std::numeric_limits<float>::quiet_NaN()});
  CHECK(error_of([&] { save_checkpoint(folder.path, 20, bad); }).fault() == Fault::diverged);
  CHECK(load_latest_checkpoint(folder.path).step == 10);
  CHECK(files_in(folder.path) == 2);
}
