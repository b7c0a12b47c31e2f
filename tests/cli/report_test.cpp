// What a training shows of itself: previews, curves, turntables, one page, event files; and pictures in terminals.
#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <sstream>

#include "models/io/image.h"
#include "runtime/error.h"
#include "tests/cli/process.h"
#include "tests/cli/small_street.h"
#include "tests/cli/small_trainings.h"

using namespace cloam;
namespace fs = std::filesystem;

namespace {

Words joined_words(Words words, const Words& more) {
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

std::set<std::string> names_in(const fs::path& folder) {
  std::set<std::string> names;
  if (!fs::exists(folder)) return names;
  for (const auto& entry : fs::directory_iterator(folder)) names.insert(entry.path().filename().string());
  return names;
}

std::vector<nlohmann::json> events_of(const fs::path& run, const std::string& name) {
  std::istringstream lines(content_of(run / "metrics.jsonl"));
  std::vector<nlohmann::json> events;
  for (std::string line; std::getline(lines, line);)
    if (auto event = nlohmann::json::parse(line); event.at("event") == name) events.push_back(event);
  return events;
}

std::string decoded(const std::string& digits) {
  const std::string alphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string bytes;
  uint32_t bits = 0;
  int count = 0;
  for (const char digit : digits) {
    if (digit == '=') break;
    bits = bits << 6 | static_cast<uint32_t>(alphabet.find(digit));
    if ((count += 6) >= 8) bytes += static_cast<char>(bits >> (count -= 8) & 255);
  }
  return bytes;
}

std::size_t count_of(const std::string& text, const std::string& what) {
  std::size_t count = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++count;
  return count;
}

/// A run with previews, curves, a report and event files, resumed once; made once.
const fs::path& shown_run() {
  static const fs::path run = [] {
    const fs::path folder = scratch() / "terminal-run";
    const Outcome first = cloam_with(
        small_training(small_scene(), folder, {"--steps", "12", "--preview-every", "4", "--tb", "--stop-after", "7"}));
    REQUIRE_MESSAGE(first.code == 0, first.err);
    const Outcome second = cloam_with({"train", "--resume", folder.string(), "--preview-every", "4"});
    REQUIRE_MESSAGE(second.code == 0, second.err);
    // On a busy machine the training had no time for the turntable.
    const Outcome report = cloam_with({"report", folder.string()});
    REQUIRE_MESSAGE(report.code == 0, report.err);
    return folder;
  }();
  return run;
}

std::string report_of(const fs::path& run, const Words& more = {"--pictures", "off"}) {
  const fs::path page = scratch() / "page.html";
  const Outcome outcome = cloam_with(joined_words({"report", run.string(), "-o", page.string()}, more));
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  return content_of(page);
}

}  // namespace

TEST_CASE("previews change no bytes of a training, of any method") {
  for (const SmallTraining& training : small_trainings()) {
    CAPTURE(training.method);
    const fs::path with = scratch() / (std::string("with-") + training.method),
                   without = scratch() / (std::string("without-") + training.method);
    const Words steps = {"--steps", "9", "--save-every", "3"};
    const Outcome shown =
        cloam_with(training.words(with, joined_words(steps, {"--preview-every", "4", "--tb", "--pictures", "on"})));
    REQUIRE_MESSAGE(shown.code == 0, shown.err);
    const Outcome plain = cloam_with(training.words(without, steps));
    REQUIRE_MESSAGE(plain.code == 0, plain.err);
    CHECK(snapshot(with / "ckpt") == snapshot(without / "ckpt"));
    const bool has_views = std::string(training.method) != "diffusion";
    const std::set<std::string> previews = {"step_000004.png", "step_000008.png", "step_000009.png"};
    CHECK(names_in(with / "preview") == (has_views ? previews : std::set<std::string>()));
    CHECK(fs::exists(with / "report.html"));
    std::set<std::string> names = names_in(without);
    std::erase_if(names, [](const std::string& name) { return name.starts_with("boxes-"); });  // of a street's actors
    CHECK(names == std::set<std::string>{"ckpt", "config.toml", "metrics.jsonl", "run.json", "scene.json"});
  }
}

TEST_CASE("a preview is the render, the photo and the error; its PSNR is that of what it shows") {
  const Image sheet = read_image(shown_run() / "preview" / "step_000012.png");
  REQUIRE(sheet.width == 3 * 24 + 2 * 4);
  const Image photo = read_image(small_scene() / "test" / "r_0.png");
  double square = 0;
  for (int y = 0; y < 24; ++y)
    for (int x = 0; x < 24; ++x)
      for (int c = 0; c < 3; ++c) {
        const auto at = [&](int image) {
          return int{sheet.pixels[static_cast<std::size_t>(3 * (y * sheet.width + image * 28 + x) + c)]};
        };
        const auto from = static_cast<std::size_t>(4 * (24 * y + x));
        const int alpha = photo.pixels[from + 3], colour = photo.pixels[from + static_cast<std::size_t>(c)];
        REQUIRE(std::abs(at(1) - (colour * alpha + 255 * (255 - alpha) + 127) / 255) <= 1);
        REQUIRE(std::abs(at(2) - std::min(255, 4 * std::abs(at(0) - at(1)))) <= 6);  // rounded thrice
        square += std::pow((at(0) - at(1)) / 255.0, 2);
      }
  const auto evals = events_of(shown_run(), "eval");
  CHECK(evals.back().at("step") == 12);
  CHECK(evals.back().at("psnr").get<double>() ==
        doctest::Approx(-10 * std::log10(square / (3 * 24 * 24))).epsilon(0.01));
}

TEST_CASE("a training that goes on keeps its previews; its curves and events go on, too") {
  CHECK(names_in(shown_run() / "preview") ==
        std::set<std::string>{"step_000004.png", "step_000007.png", "step_000008.png", "step_000012.png"});
  const std::string svg = content_of(shown_run() / "curves.svg");
  CHECK(count_of(svg, "<circle") == 4);
  for (const char* words : {">loss<", ">PSNR, dB", ">learning rate<", ">step<", ">12<"}) CHECK(contains(svg, words));
}

TEST_CASE("what a kill lost is no part of the curves") {
  const fs::path run = copy_of(small_run(), "lost-steps");
  const auto event = [](int step, double loss) {
    return text(R"({"schema_version":1,"event":"step","t":1,"step":)", step, R"(,"loss":)", loss,
                R"(,"learning_rate":0.1,"metrics":{}})", "\n");
  };
  const std::string start = R"({"schema_version":1,"event":"start","t":0,"step":2})"
                            "\n";
  write_text(run / "metrics.jsonl", event(1, 4) + event(2, 3) + event(3, 1000) + start + event(3, 2) + event(4, 1) +
                                        R"({"event":"step","t")");  // cut by a kill
  report_of(run);
  const std::string svg = content_of(run / "curves.svg");
  CHECK_FALSE(contains(svg, "1,000"));
  std::smatch path;
  REQUIRE(std::regex_search(svg, path, std::regex("<path class=\"raw\" d=\"([^\"]+)\"")));
  CHECK(count_of(path[1], "L") == 3);
}

TEST_CASE("no more than a hundred previews stay, the first and the last among them") {
  const fs::path run = scratch() / "many";
  const Outcome outcome = cloam_with(small_training(small_scene(), run, {"--steps", "110", "--preview-every", "1"}));
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  const auto names = names_in(run / "preview");
  CHECK(names.size() == 100);
  CHECK(*names.begin() == "step_000001.png");
  CHECK(*names.rbegin() == "step_000110.png");
  int last = 0, widest = 0;
  for (const std::string& name : names) {
    const int step = std::stoi(name.substr(5));
    widest = std::max(widest, step - last);
    last = step;
  }
  CHECK(widest <= 3);  // evenly
}

TEST_CASE("--preview-every takes steps, times, auto and off, and tells of anything else before it reads") {
  for (const char* wrong : {"0", "-3", "often", "5x", "3.5"}) {
    const Outcome outcome = cloam_with({"train", "nerf", "nowhere", "--preview-every", wrong});
    CHECK(outcome.code == 2);
    CHECK_MESSAGE(contains(outcome.err, std::string("--preview-every ") + wrong), outcome.err);
  }
  const fs::path run = scratch() / "seldom";
  REQUIRE(cloam_with(small_training(small_scene(), run, {"--steps", "5", "--preview-every", "off"})).code == 0);
  CHECK_FALSE(fs::exists(run / "preview"));
}

TEST_CASE("the report of a run is one file, with what it is, its curves and pictures") {
  const std::string page = content_of(shown_run() / "report.html");
  for (const char* words :
       {"Finished: 12 of 12 steps", "nerf, preset nerf", "<svg", "turntable", "step 4", "step 12",
        "<td>batch.rays</td><td><b>64</b></td><td>1024</td>", "Not evaluated yet", "--stop-after 7", "ckpt/ ("})
    CHECK_MESSAGE(contains(page, words), words);
  CHECK(contains(page, json_of(shown_run() / "run.json").at("device").get<std::string>()));
  const std::regex source("(src|href)=\"([^\"]{0,16})");
  int pictures = 0;
  for (std::sregex_iterator match(page.begin(), page.end(), source), end; match != end; ++match, ++pictures)
    CHECK_MESSAGE((*match)[2].str().starts_with("data:image/"), (*match)[2].str());
  CHECK(pictures >= 5);  // the newest preview, the turntable, previews over time
  CHECK_FALSE(contains(page, "<script"));
  std::smatch gif;
  const std::size_t at = page.find("data:image/gif;base64,");
  REQUIRE(at != std::string::npos);
  CHECK(decoded(page.substr(at + 22, page.find('"', at + 22) - at - 22)) == content_of(shown_run() / "turntable.gif"));
}

TEST_CASE("the report holds an evaluation beside its baselines, and says when it is of an earlier step") {
  const fs::path run = copy_of(shown_run(), "measured");
  REQUIRE(cloam_with({"eval", run.string(), "-q", "--data", small_scene().string()}).code == 0);
  const auto eval = json_of(run / "eval" / "eval.json");
  const std::string page = report_of(run);
  for (const char* key : {"psnr", "baseline_mean_colour_psnr"}) {
    std::ostringstream figure;
    figure.precision(2);
    figure << std::fixed << eval.at(key).get<double>();
    CHECK(contains(page, std::string("<td>") + key + "</td><td class=\"number\"><b>" + figure.str() + "</b>"));
  }
  CHECK(contains(page, "test_r_1: render, photo, error"));
  CHECK_FALSE(contains(page, "Not evaluated yet"));
  auto record = json_of(run / "run.json");
  record["step"] = 40;
  write_text(run / "run.json", record.dump());
  CHECK(contains(report_of(run), "The evaluation is of step 12"));
}

TEST_CASE("reports of runs that stopped, were edited, learned from a run") {
  const std::string stopped = report_of(stopped_run());
  CHECK(contains(stopped, "Unfinished: stopped after 5 of 40 steps"));
  CHECK(contains(stopped, "cloam train --resume " + stopped_run().string()));
  const fs::path edited = scratch() / "edited-for-report";
  const auto list = nlohmann::json::parse(cloam_with({"edit", small_street_run().string(), "--list", "--json"}).out);
  const std::string id = list.at("actors").at(0).at("actor");
  REQUIRE(
      cloam_with({"edit", small_street_run().string(), "--actor", id + ":shift=1,0,0", "-o", edited.string()}).code ==
      0);
  const std::string page = report_of(edited, {});
  CHECK(contains(page, "An edited run: the model of " + small_street_run().string()));
  CHECK(contains(page, "the actors that most images show"));
  CHECK(fs::exists(edited / "drive.gif"));
  CHECK(fs::exists(edited / "assets.png"));
  const std::string diffusion = report_of(copy_of(small_diffusion_run(), "reported-diffusion"));
  CHECK(contains(diffusion, "diffusion, preset diffusion-small"));
  CHECK(contains(diffusion, ">loss<"));
}

TEST_CASE("a damaged run is one error, and the page that was there stays") {
  const fs::path run = copy_of(shown_run(), "damaged");
  const std::string before = content_of(run / "report.html");
  const std::string log = content_of(run / "metrics.jsonl"), record = content_of(run / "run.json");
  const auto refused = [&](const std::string& words) {
    const Outcome outcome = cloam_with({"report", run.string(), "--pictures", "off"});
    CHECK(outcome.code == 3);
    CHECK_MESSAGE(contains(outcome.err, words), outcome.err);
    CHECK(content_of(run / "report.html") == before);
  };
  write_text(run / "metrics.jsonl", "no event\n" + log);
  refused("metrics.jsonl, line 1");
  write_text(run / "metrics.jsonl", log);
  write_text(run / "preview" / "step_000012.png", "no picture");
  refused("step_000012.png");
  write_text(run / "run.json", record.substr(0, record.size() / 2));
  refused("run.json");
  const Outcome none = cloam_with({"report", (scratch() / "nowhere").string()});
  CHECK(none.code == 2);
}

TEST_CASE("--tb: event files with the numbers of the log, and a new one when the training goes on") {
  std::vector<std::string> files;
  for (const std::string& name : names_in(shown_run()))
    if (name.starts_with("events.out.tfevents.")) files.push_back(name);
  REQUIRE(files.size() == 2);
  std::string bytes[2];
  for (std::size_t i = 0; i < 2; ++i) {
    bytes[i] = content_of(shown_run() / files[i]);
    CHECK(contains(bytes[i], "brain.Event:2"));
    CHECK(contains(bytes[i], "preview/psnr"));
    CHECK(contains(bytes[i], "\x89PNG"));
  }
  CHECK_FALSE(contains(bytes[0], "\x3a\x02\x08\x01"));    // session_log { status: START }
  CHECK(contains(bytes[1], "\x10\x08\x3a\x02\x08\x01"));  // step: 8
  const auto steps = events_of(shown_run(), "step");
  const auto holds = [](const std::string& file, const std::string& tag, double value) {
    const auto number = static_cast<float>(value);
    std::string wanted = tag + "\x15" + std::string(4, '\0');
    std::memcpy(wanted.data() + wanted.size() - 4, &number, 4);
    return contains(file, wanted);
  };
  for (const auto& event : steps) {
    const std::string& file = bytes[event.at("step").get<int>() > 7 ? 1 : 0];
    CHECK(holds(file, "train/loss", event.at("loss")));
    CHECK(holds(file, "train/psnr", event.at("metrics").at("psnr")));
    CHECK(holds(file, "train/learning_rate", event.at("learning_rate")));
  }
}

TEST_CASE("pictures in a terminal: each protocol carries the picture that was written") {
  const fs::path out = scratch() / "shown-views";
  const auto shown = [&](const std::string& kind) {
    const Outcome outcome = cloam_with({"render", shown_run().string(), "-o", out.string(), "--show" + kind});
    REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
    return outcome;
  };
  const std::string kitty = shown("=kitty").out;
  const Image image = read_image(out / "test_r_0.png");
  const std::string pixels(image.pixels.begin(), image.pixels.end());
  std::string digits;
  const std::regex piece("\033_G([^;]*);([^\033]*)\033\\\\");
  for (std::sregex_iterator match(kitty.begin(), kitty.end(), piece), end; match != end; ++match) {
    if (digits.empty()) CHECK(contains((*match)[1], "f=24,s=24,v=24"));
    digits += (*match)[2];
  }
  CHECK(decoded(digits) == pixels);

  const std::string blocks = shown("=blocks").out;
  const std::regex cell("\033\\[38;2;(\\d+);(\\d+);(\\d+)m\033\\[48;2;(\\d+);(\\d+);(\\d+)m\u2580");
  std::string drawn(pixels.size(), '\0');
  std::size_t cells = 0;
  for (std::sregex_iterator match(blocks.begin(), blocks.end(), cell), end; match != end; ++match, ++cells)
    for (std::size_t half = 0; half < 2; ++half)
      for (std::size_t c = 0; c < 3; ++c) {
        const std::size_t x = cells % 24, y = 2 * (cells / 24) + half;
        drawn.at(3 * (24 * y + x) + c) = static_cast<char>(std::stoi((*match)[1 + 3 * half + c]));
      }
  CHECK(cells == 12 * 24);
  CHECK(drawn == pixels);
  CHECK(std::count(blocks.begin(), blocks.end(), '\n') == 12);

  const std::string iterm = shown("=iterm").out;
  REQUIRE(iterm.starts_with("\033]1337;File=inline=1;"));
  const std::size_t colon = iterm.find(':');
  write_text(scratch() / "iterm.jpg", decoded(iterm.substr(colon + 1, iterm.find('\a') - colon - 1)));
  const Image jpeg = read_image(scratch() / "iterm.jpg");
  REQUIRE(jpeg.pixels.size() == pixels.size());
  double apart = 0;
  for (std::size_t i = 0; i < pixels.size(); ++i) apart += std::abs(jpeg.pixels[i] - image.pixels[i]);
  CHECK(apart / static_cast<double>(pixels.size()) < 4);

  const Outcome none = shown("");
  CHECK(none.out.empty());
  CHECK(contains(none.err, "stdout is not a terminal"));
  const Outcome wrong = cloam_with({"render", shown_run().string(), "-o", out.string(), "--show=block"});
  CHECK(wrong.code == 2);
  CHECK_MESSAGE(contains(wrong.err, "did you mean blocks?"), wrong.err);
}

TEST_CASE("sixel: bands of six rows in 216 colours, whose mean is the picture's") {
  const Outcome outcome = cloam_with(
      {"render", shown_run().string(), "-o", (scratch() / "sixel-views").string(), "--show=sixel", "--size", "40x32"});
  REQUIRE_MESSAGE(outcome.code == 0, outcome.err);
  const std::string& text = outcome.out;
  REQUIRE(text.starts_with("\033P0;1q\"1;1;40;32"));
  const Image image = read_image(scratch() / "sixel-views" / "test_r_0.png");
  std::map<int, std::array<int, 3>> palette;
  std::vector<int> drawn(40 * 32 * 3, -1);
  std::size_t at = std::string("\033P0;1q\"1;1;40;32").size();
  const auto number = [&] {
    int value = 0;
    while (std::isdigit(static_cast<unsigned char>(text[at]))) value = 10 * value + (text[at++] - '0');
    return value;
  };
  int colour = 0, x = 0, top = 0;
  while (text[at] != '\033') {
    const char letter = text[at++];
    int repeat = 1;
    char bits = letter;
    if (letter == '#') {
      colour = number();
      if (text[at] != ';') continue;
      int parts[4];
      for (int& part : parts) ++at, part = number();
      palette[colour] = {parts[1], parts[2], parts[3]};
      continue;
    }
    if (letter == '$') x = 0;
    if (letter == '-') x = 0, top += 6;
    if (letter == '$' || letter == '-') continue;
    if (letter == '!') repeat = number(), bits = text[at++];
    REQUIRE((bits >= '?' && bits <= '~'));
    for (; repeat > 0; --repeat, ++x)
      for (int row = 0; row < 6; ++row)
        if ((bits - '?') >> row & 1)
          for (std::size_t c = 0; c < 3; ++c)
            drawn.at(static_cast<std::size_t>(3 * (40 * (top + row) + x)) + c) = palette.at(colour)[c] * 255 / 100;
  }
  CHECK(std::count(drawn.begin(), drawn.end(), -1) == 0);
  double sums[2][3] = {};
  for (std::size_t i = 0; i < drawn.size(); ++i) {
    CHECK(std::abs(drawn[i] - image.pixels[i]) <= 110);
    sums[0][i % 3] += drawn[i], sums[1][i % 3] += image.pixels[i];
  }
  for (std::size_t c = 0; c < 3; ++c) CHECK(std::abs(sums[0][c] - sums[1][c]) / (40 * 32) < 4);
}
