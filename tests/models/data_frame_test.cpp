// Pickled data frames: our own, pandas' own, real-layout files, and hostile ones.
#include "models/data/data_frame.h"

#include <doctest/doctest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>

#include "models/io/bytes.h"
#include "models/io/gzip.h"
#include "runtime/error.h"
#include "tests/hostile_pickles.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"

namespace fs = std::filesystem;
using namespace cloam;

namespace {

std::span<const std::uint8_t> bytes_of(const std::string& content) {
  return {reinterpret_cast<const std::uint8_t*>(content.data()), content.size()};
}

std::string error_of(const std::string& pickle) {
  return cloam::error_of([&] { parse_data_frame(bytes_of(pickle), "x.pkl"); });
}

DataFrame small_frame() {
  DataFrame frame;
  frame.add({"x", std::vector<double>{1.5, -2, 1e300}});
  frame.add({"label", std::vector<std::string>{"Car", "", "Tram / Subway \xc3\xa9"}});
  frame.add({"d", std::vector<std::int64_t>{0, -1, std::int64_t{1} << 60}});
  frame.add({"stationary", std::vector<std::uint8_t>{1, 0, 1}});
  frame.add({"y", std::vector<double>{0, std::nan(""), -0.0}});
  return frame;
}

void require_small_frame(const DataFrame& frame) {
  const DataFrame wanted = small_frame();
  REQUIRE(frame.columns().size() == wanted.columns().size());
  CHECK(frame.rows() == 3);
  for (std::size_t i = 0; i < wanted.columns().size(); ++i) {
    CHECK(frame.columns()[i].name == wanted.columns()[i].name);
    CHECK(frame.columns()[i].values.index() == wanted.columns()[i].values.index());
  }
  CHECK(frame.columns()[2].values == wanted.columns()[2].values);
  CHECK(frame.columns()[3].values == wanted.columns()[3].values);
  CHECK(frame.numbers("x") == wanted.numbers("x"));
  CHECK(frame.texts("label") == wanted.texts("label"));
  CHECK(std::isnan(frame.numbers("y")[1]));
  CHECK(std::signbit(frame.numbers("y")[2]));
}

// An interpreter that has pandas, or "".
std::string python() {
  for (const char* name : {"python3", "/usr/bin/python3"}) {
    if (std::system((std::string(name) + " -c 'import pandas' >/dev/null 2>&1").c_str()) == 0) return name;
  }
  return "";
}

bool run_python(const std::string& name, const fs::path& folder, const std::string& program) {
  std::ofstream(folder / "program.py") << program;
  return std::system(("cd " + folder.string() + " && " + name + " program.py").c_str()) == 0;
}

}  // namespace

TEST_CASE("a data frame reads back as it was written, and equal frames give equal bytes") {
  const Folder folder;
  write_data_frame(folder.path / "a.pkl.gz", small_frame());
  require_small_frame(read_data_frame(folder.path / "a.pkl.gz"));
  write_data_frame(folder.path / "b.pkl.gz", small_frame());
  CHECK(read_file(folder.path / "a.pkl.gz", 1 << 20) == read_file(folder.path / "b.pkl.gz", 1 << 20));
  CHECK(parse_data_frame(pickle_data_frame(DataFrame()), "empty").rows() == 0);
  DataFrame no_rows;
  no_rows.add({"x", std::vector<double>()});
  no_rows.add({"uuid", std::vector<std::string>()});
  const DataFrame read = parse_data_frame(pickle_data_frame(no_rows), "no rows");
  CHECK(read.numbers("x").empty());
  CHECK(read.texts("uuid").empty());
}

TEST_CASE("columns that are missing or of another kind are named") {
  const DataFrame frame = parse_data_frame(pickle_data_frame(small_frame()), "x.pkl");
  const auto message = [&](const std::function<void()>& action) -> std::string {
    try {
      action();
    } catch (const Error& error) { return error.what(); }
    return "";
  };
  CHECK(message([&] { frame.numbers("z"); }) == "x.pkl: no column z; it has x, label, d, stationary, y");
  CHECK(message([&] { frame.numbers("label"); }) == "x.pkl: the column label does not hold numbers");
  CHECK(message([&] { frame.texts("d"); }) == "x.pkl: the column d does not hold strings");
  CHECK(frame.numbers("stationary") == std::vector<double>{1, 0, 1});
}

TEST_CASE("hostile pickles give an error of the data with the byte, and run nothing") {
  const Folder folder;
  const fs::path canary = folder.path / "canary";
  const auto pickles = hostile_pickles(canary.string());
  CHECK(pickles.size() >= 50);
  for (const HostilePickle& pickle : pickles) {
    CAPTURE(pickle.name);
    const std::string message = error_of(pickle.bytes);
    CHECK_MESSAGE(holds(message, "x.pkl: "), message);
    CHECK_MESSAGE(holds(message, "byte"), message);
    CHECK_FALSE(fs::exists(canary));
  }
  CHECK(parse_data_frame(bytes_of(hostile::sound()), "x.pkl").numbers("x") == std::vector<double>{0});
  CHECK(holds(error_of(pickles[0].bytes), "byte 2: the pickle asks for \"os system\""));
}

TEST_CASE("a pickle cut short or with any byte replaced reads or gives an error of the data") {
  const std::string sound = hostile::sound();
  for (std::size_t length = 0; length < sound.size(); ++length) CHECK(error_of(sound.substr(0, length)) != "no error");
  const auto ours = pickle_data_frame(small_frame());
  const std::string old_form(ours.begin(), ours.end());
  for (const std::string& all : {sound, old_form}) {
    for (std::size_t at = 0; at < all.size(); ++at) {
      for (const char put : {'\0', '\x01', '\xff', '0', ']', 't', 'R', 'b', '(', 'h', '\x80', '.'}) {
        std::string changed = all;
        changed[at] = put;
        error_of(changed);
      }
    }
  }
}

TEST_CASE("gzip: round trip, bombs, damage, what follows the end") {
  std::vector<std::uint8_t> content(100000);
  for (std::size_t i = 0; i < content.size(); ++i) content[i] = static_cast<std::uint8_t>(i * i >> 7);
  const auto packed = gzip(content);
  CHECK(gunzip(packed, 1 << 20, "x") == content);
  const auto refused = [](std::vector<std::uint8_t> bytes, std::uint64_t largest) {
    try {
      gunzip(bytes, largest, "x");
    } catch (const Error& error) {
      CHECK(error.fault() == Fault::data);
      return true;
    }
    return false;
  };
  CHECK(refused(packed, content.size() - 1));
  CHECK(refused(gzip(std::vector<std::uint8_t>(64 << 20)), std::uint64_t{1} << 30));
  auto damaged = packed;
  damaged.push_back(0);
  CHECK(refused(damaged, 1 << 20));
  for (const std::size_t length : {std::size_t{0}, std::size_t{5}, packed.size() / 2, packed.size() - 1}) {
    CHECK(refused({packed.begin(), packed.begin() + static_cast<std::ptrdiff_t>(length)}, 1 << 20));
  }
  damaged = packed;
  damaged[packed.size() - 6] ^= 1;  // the checksum
  CHECK(refused(damaged, 1 << 20));
}

TEST_CASE("pandas reads what we write, and we read what pandas writes in protocols 2 to 5") {
  const std::string interpreter = python();
  if (interpreter.empty()) {
    MESSAGE("skipped: no pandas (apt-get install python3-pandas)");
    return;
  }
  const Folder folder;
  write_data_frame(folder.path / "ours.pkl.gz", small_frame());
  write_data_frame(folder.path / "empty.pkl.gz", DataFrame());
  REQUIRE(run_python(interpreter, folder.path, R"(
import gzip, pickle
import numpy as np
import pandas as pd
ours = pd.read_pickle('ours.pkl.gz')
assert list(ours.columns) == ['x', 'label', 'd', 'stationary', 'y'], ours.columns
assert list(ours.x) == [1.5, -2, 1e300] and ours.x.dtype == np.float64
assert list(ours.label) == ['Car', '', 'Tram / Subway \u00e9']
assert list(ours.d) == [0, -1, 2**60] and ours.d.dtype == np.int64
assert list(ours.stationary) == [True, False, True] and ours.stationary.dtype == bool
assert np.isnan(ours.y[1]) and list(ours.index) == [0, 1, 2]
assert len(ours[ours.d > -1].copy().reset_index(drop=True)) == 2
assert len(pd.read_pickle('empty.pkl.gz')) == 0
frame = pd.DataFrame({'x': [1.5, -2, 1e300], 'label': ['Car', '', 'Tram / Subway \u00e9'], 'd': [0, -1, 2**60],
                      'stationary': [True, False, True], 'y': [0, np.nan, -0.0]})
odd = frame.assign(small=np.arange(3, dtype=np.int8), half=np.arange(3, dtype=np.float32), none=['a', None, np.nan],
                   mixed=pd.Series([1, 2.5, True], dtype=object), when=pd.Timestamp('2020-01-01'),
                   group=pd.Categorical(['a', 'b', 'a']), notes=[{'a': 1}, 'b', None])
for protocol in range(2, 6):
    for name, value in [('same', frame), ('odd', odd), ('part', odd[odd.d > -1]), ('none', frame[frame.d > 2**61]),
                        ('sorted', frame.sort_values('x')[['x', 'label']]), ('turned', frame[['y', 'x']].T.T),
                        ('numbered', pd.DataFrame(np.arange(6.).reshape(3, 2)))]:
        with gzip.open('%s%d.pkl.gz' % (name, protocol), 'wb') as file:
            pickle.dump(value, file, protocol=protocol)
)"));
  const std::vector<double> xs = {1.5, -2, 1e300};
  for (int protocol = 2; protocol <= 5; ++protocol) {
    CAPTURE(protocol);
    const auto read = [&](const std::string& name) {
      return read_data_frame(folder.path / (name + std::to_string(protocol) + ".pkl.gz"));
    };
    require_small_frame(read("same"));
    const DataFrame odd = read("odd");
    CHECK(odd.numbers("small") == std::vector<double>{0, 1, 2});
    CHECK(odd.numbers("half") == std::vector<double>{0, 1, 2});
    CHECK(odd.numbers("mixed") == std::vector<double>{1, 2.5, 1});
    CHECK(odd.texts("none") == std::vector<std::string>{"a", "", ""});
    CHECK_THROWS_AS(odd.numbers("when"), Error);
    CHECK_THROWS_AS(odd.texts("group"), Error);
    CHECK_THROWS_WITH_AS(odd.texts("notes"), doctest::Contains("the column notes does not hold"), Error);
    CHECK(read("part").numbers("x") == std::vector<double>{1.5, 1e300});
    CHECK(read("part").texts("label") == std::vector<std::string>{"Car", "Tram / Subway \xc3\xa9"});
    CHECK(read("none").rows() == 0);
    CHECK(read("sorted").numbers("x") == std::vector<double>{-2, 1.5, 1e300});
    CHECK(read("turned").numbers("x") == xs);
    CHECK(read("numbered").numbers("1") == std::vector<double>{1, 3, 5});
  }
}

TEST_CASE("pandaset-mini: every data frame of all logs") {
  const fs::path root = test_data("pandaset-mini");
  if (no_data(root)) return;
  int sweeps = 0, boxes = 0;
  for (const auto& entry : fs::recursive_directory_iterator(root)) {
    if (entry.path().extension() != ".gz") continue;
    const DataFrame frame = read_data_frame(entry.path());
    const bool sweep = frame.has("i");
    ++(sweep ? sweeps : boxes);
    CHECK(frame.rows() > (sweep ? 1000 : 0));
    CHECK(frame.numbers(sweep ? "x" : "position.x").size() == frame.rows());
    if (!sweep) CHECK(frame.texts("uuid")[0].size() == 36);
  }
  CHECK(sweeps == 160);
  CHECK(boxes == 160);
}
