// cloam view: what a page asks for over HTTP, against the real program: pictures are those of render, saved runs those
// of edit, and whoever lacks the token learns nothing.
#include <doctest/doctest.h>

#include <chrono>
#include <csignal>
#include <future>
#include <thread>

#include "models/gaussians/gaussian_ply.h"
#include "models/io/json.h"
#include "models/mesh/write_mesh.h"
#include "tests/cli/process.h"
#include "tests/cli/small_street.h"
#include "tests/cli/small_trainings.h"

// Last: a header of the system that it includes has macros that Eigen does not survive.
#include <httplib.h>

using namespace cloam;
namespace fs = std::filesystem;

namespace {

struct Reply {
  int status = 0;
  std::string body;
  httplib::Headers headers;
  Json json() const { return Json::parse(body); }
  std::string header(const std::string& name) const {
    const auto found = headers.find(name);
    return found == headers.end() ? "" : found->second;
  }
};

Reply reply_of(const httplib::Result& result) {
  REQUIRE_MESSAGE(bool(result), "no answer: " << to_string(result.error()));
  return {result->status, result->body, result->headers};
}

/// A program that printed an address, and requests to it.
class Viewer {
 public:
  explicit Viewer(Words words) : out_(scratch() / ("viewer" + std::to_string(count_++))) {
    words.insert(words.begin(), "view");
    words.insert(words.end(), {"--no-open", "--json", "-q"});
    process_.emplace(words, Words{}, out_.string());
    for (int i = 0; i < 3000 && content_of(out_).find('\n') == std::string::npos && process_->running(); ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    const std::string line = content_of(out_);
    if (line.empty()) FAIL("the viewer printed nothing: " << process_->wait().err);
    const Json told = Json::parse(line);
    port_ = told["port"];
    root_ = told["address"].get<std::string>().substr(std::string("http://127.0.0.1:").size() +
                                                      std::to_string(port_).size());
  }

  Reply get(const std::string& path) const { return at(root_ + path); }
  /// Wherever it is.
  Reply at(const std::string& path) const { return reply_of(client().Get(path)); }
  Reply post_text(const std::string& path, const std::string& body) const {
    return reply_of(client().Post(root_ + path, body, "application/json"));
  }
  Reply post(const std::string& path, const Json& body = Json::object()) const { return post_text(path, body.dump()); }
  Outcome quit() {
    CHECK(post("quit").status == 200);
    return process_->wait();
  }
  Process& process() { return *process_; }
  httplib::Client client() const {
    httplib::Client client("127.0.0.1", port_);
    client.set_read_timeout(60, 0);
    return client;
  }
  int port() const { return port_; }
  const std::string& root() const { return root_; }

 private:
  inline static int count_ = 0;
  fs::path out_;
  std::optional<Process> process_;
  int port_ = 0;
  std::string root_;
};

/// A file of three gaussians with numbers of their own.
fs::path small_ply() {
  static const fs::path path = [] {
    Gaussians g;
    for (int i = 0; i < 3; ++i) {
      const auto v = static_cast<float>(i);
      for (const float x : {v, 2 * v, -v})
        g.means.push_back(x), g.scales.push_back(-2 - x / 9), g.sh_first.push_back(x);
      for (const float x : {1.f, 0.f, v, 0.f}) g.rotations.push_back(x);
      g.opacities.push_back(v - 1);
    }
    g.sh_rest.assign(3 * 3 * kSphericalRest, 0);
    g.up = Eigen::Vector3d::UnitY();
    write_gaussian_ply(scratch() / "three.ply", g);
    return scratch() / "three.ply";
  }();
  return path;
}

/// What a page sends for one of the scene's cameras, at another size.
Json frame_of(const Json& camera, int width, int height) {
  Json frame = {{"client", "page"}, {"number", 1}, {"level", 2}, {"format", "png"}};
  frame["width"] = width, frame["height"] = height;
  frame["fx"] = camera["fx"].get<double>() * width / camera["width"].get<double>();
  frame["fy"] = camera["fy"].get<double>() * height / camera["height"].get<double>();
  frame["cx"] = 0.5 * width, frame["cy"] = 0.5 * height;
  frame["world_from_camera"] = camera["world_from_camera"];
  frame["time"] = camera["time"].is_null() ? Json(0) : camera["time"];
  return frame;
}

/// The PNG that `cloam render` makes of a run for the same camera.
std::string rendered(const fs::path& run, const Json& frame, const std::string& name) {
  Json matrix = Json::array();
  for (std::size_t row = 0; row < 3; ++row) {  // OpenGL's axes
    const auto at = [&](std::size_t i) { return frame["world_from_camera"][4 * row + i].get<double>(); };
    matrix.push_back({at(0), -at(1), -at(2), at(3)});
  }
  matrix.push_back({0, 0, 0, 1});
  Json camera = {{"w", frame["width"]}, {"h", frame["height"]}, {"fl_x", frame["fx"]},   {"fl_y", frame["fy"]},
                 {"cx", frame["cx"]},   {"cy", frame["cy"]},    {"time", frame["time"]}, {"transform_matrix", matrix}};
  if (frame.contains("log")) camera["log"] = frame["log"];
  const fs::path file = scratch() / (name + ".json"), out = scratch() / name;
  write_text(file, camera.dump());
  const Outcome made = cloam_with({"render", run.string(), "--camera", file.string(), "-o", out.string(), "-q"});
  REQUIRE_MESSAGE(made.code == 0, made.err);
  return content_of(out / "camera_0000.png");
}

Json with(Json json, const Json& more) {
  json.update(more);
  return json;
}

}  // namespace

TEST_CASE("view: a file of Gaussians, for whoever has the token") {
  Viewer viewer({small_ply().string()});
  const std::string root = viewer.root(), wrong = "/" + std::string(root.size() - 2, '0') + "/";
  for (const std::string& path : {std::string("/"), std::string("/scene.json"), wrong, wrong + "scene.json",
                                  root.substr(0, root.size() - 1), root.substr(0, root.size() - 2) + "/"}) {
    CAPTURE(path);
    const Reply refused = viewer.at(path);
    CHECK(refused.status == 403);
    CHECK(contains(refused.body, "token"));
  }
  CHECK(contains(viewer.get("").body, "<title>"));
  const Json scene = viewer.get("scene.json").json();
  CHECK(scene["kind"] == "gaussians");
  CHECK(scene["title"] == "three.ply");
  CHECK(scene["splats"] == "splats.ply");
  CHECK(scene["up"] == Json({0.0, 1.0, 0.0}));
  CHECK(scene["centre"] == Json({1.0, 2.0, -1.0}));  // the median
  CHECK(viewer.get("splats.ply").body == content_of(small_ply()));
  CHECK(viewer.get("elsewhere").status == 404);
  CHECK(contains(viewer.get("actors?time=0").json()["error"].get<std::string>(), "no actors"));
  CHECK(viewer.post("edit", Json{{"op", "hide"}, {"id", "x"}}).status == 404);
  CHECK(viewer.get("photos/0").status == 404);

  const Outcome taken =
      cloam_with({"view", small_ply().string(), "--no-open", "--port", std::to_string(viewer.port())});
  CHECK(taken.code == 2);
  CHECK(contains(taken.err, "another program has this port"));
  const Outcome ended = viewer.quit();
  CHECK_MESSAGE(ended.code == 0, ended.err);
}

TEST_CASE("view: Ctrl-C ends it, and tells the pages") {
  Viewer viewer({small_ply().string()});
  std::string heard;
  auto events = std::async(std::launch::async, [&] {
    (void)viewer.client().Get(viewer.root() + "events", [&](const char* data, size_t size) {
      heard.append(data, size);
      return true;
    });
  });
  CHECK(viewer.get("scene.json").status == 200);
  viewer.process().signal(SIGINT);
  const Outcome ended = viewer.process().wait();
  CHECK_MESSAGE(ended.code == 0, ended.err);
  events.wait();
  CHECK(contains(heard, R"("end")"));
}

TEST_CASE("view: what is not there is told with what would do") {
  const Outcome missing = cloam_with({"view", small_run().string() + "x", "--no-open"});
  CHECK(missing.code == 2);
  CHECK(contains(missing.err, "did you mean"));
  const Outcome no_file = cloam_with({"view", (scratch() / "none.ply").string(), "--no-open"});
  CHECK(no_file.code == 3);
  const Outcome no_run = cloam_with({"view", scratch().string(), "--no-open"});
  CHECK(no_run.code == 3);
  const fs::path mesh = scratch() / "mesh.glb";
  Mesh triangle;
  triangle.positions = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  triangle.normals = {0, 0, 1, 0, 0, 1, 0, 0, 1};
  triangle.colours.assign(9, 0.5f);
  triangle.triangles = {0, 1, 2};
  write_glb(mesh, triangle, {"triangle", {}});
  const Outcome no_gaussians = cloam_with({"view", mesh.string(), "--no-open"});
  CHECK(no_gaussians.code == 3);
  CHECK(contains(no_gaussians.err, "mesh"));
}

TEST_CASE("view: a frame is what render makes, and what is no longer wanted is dropped") {
  Viewer viewer({small_run().string()});
  const Json scene = viewer.get("scene.json").json();
  CHECK(scene["kind"] == "rendered");
  CHECK(scene["method"] == "nerf");
  REQUIRE(scene["cameras"].size() == 10);
  const Json camera = scene["cameras"][3], frame = frame_of(camera, 40, 30);
  const Reply full = viewer.post("frame", frame);
  REQUIRE_MESSAGE(full.status == 200, full.body);
  CHECK(full.header("X-Scale") == "1");
  CHECK(full.header("X-Number") == "1");
  CHECK((full.body == rendered(small_run(), frame, "of_nerf")));
  const Reply coarse = viewer.post("frame", with(frame, {{"level", 0}, {"number", 2}, {"format", "jpeg"}}));
  CHECK(coarse.status == 200);
  CHECK(coarse.header("Content-Type") == "image/jpeg");
  CHECK(viewer.get(camera["photo"]).header("Content-Type") == "image/jpeg");
  CHECK(viewer.get("photos/10").status == 404);

  // While one client's frame takes long, another's coarse one comes; then a newer number drops the long one.
  const Json large = with(frame_of(camera, 2000, 2000), {{"number", 3}});
  auto slow = std::async(std::launch::async, [&] { return viewer.post("frame", large); });
  const Reply other = viewer.post("frame", with(frame, {{"client", "another"}, {"level", 0}}));
  CHECK(other.status == 200);
  CHECK(viewer.get("scene.json").status == 200);
  CHECK(viewer.post("frame", with(frame, {{"number", 4}})).body == full.body);
  const Reply dropped = slow.get();
  CHECK(dropped.status == 409);
  CHECK(dropped.json()["error"] == "superseded");
  CHECK(viewer.post("frame", with(frame, {{"number", 2}})).status == 409);

  // A long one does not hold the end up.
  auto last = std::async(std::launch::async, [&] { return viewer.post("frame", with(large, {{"number", 5}})).status; });
  CHECK(viewer.get("scene.json").status == 200);
  CHECK(viewer.quit().code == 0);
  CHECK(last.get() == 503);
}

TEST_CASE("view: requests that make no sense are refused, and the next one is answered") {
  Viewer viewer({small_run().string()});
  const Json good = frame_of(viewer.get("scene.json").json()["cameras"][0], 8, 6);
  for (const Json& change : std::vector<Json>{{{"width", 100000}},
                                              {{"width", 8192}, {"height", 8192}},
                                              {{"width", -1}},
                                              {{"width", 7.5}},
                                              {{"width", "wide"}},
                                              {{"fx", 0}},
                                              {{"fx", nullptr}},
                                              {{"cx", 1e300}},
                                              {{"time", "noon"}},
                                              {{"level", 3}},
                                              {{"number", -1}},
                                              {{"client", ""}},
                                              {{"client", std::string(1000, 'x')}},
                                              {{"format", "tiff"}},
                                              {{"world_from_camera", {1, 2, 3}}},
                                              {{"world_from_camera", std::vector<double>(12, 0)}},
                                              {{"world_from_camera", std::vector<std::string>(12, "1")}}}) {
    CAPTURE(change.dump());
    const Reply refused = viewer.post("frame", with(good, change));
    CHECK(refused.status == 400);
    CHECK(contains(refused.json()["error"].get<std::string>(), "the request: "));
  }
  std::string not_a_number = good.dump();
  not_a_number.replace(not_a_number.find("\"fx\":") + 5, 1, "NaN,\"was\":");
  for (const std::string& body : {std::string("{\"client\": "), std::string(), std::string("[1]"), std::string(99, '['),
                                  std::string("\xff\xfe"), not_a_number}) {
    CAPTURE(body);
    CHECK(viewer.post_text("frame", body).status == 400);
  }
  CHECK(viewer.post_text("frame", std::string(3 << 20, ' ')).status == 413);
  CHECK(viewer.get("lidar?time=never").status >= 400);
  CHECK(viewer.get("photos/99999999999999999999").status == 404);
  CHECK(viewer.get("thumbnails/..%2f..%2frun.json").status == 404);
  CHECK(viewer.post("frame", good).status == 200);
}

TEST_CASE("view: Gaussians of a run are drawn in the browser") {
  const fs::path run = scratch() / "splats_to_view";
  const Outcome trained = cloam_with(small_trainings()[1].words(run, {"--steps", "2", "-q"}));
  REQUIRE_MESSAGE(trained.code == 0, trained.err);
  Viewer viewer({run.string()});
  const Json scene = viewer.get("scene.json").json();
  CHECK(scene["kind"] == "gaussians");
  const fs::path file = scratch() / "exported.ply";
  CHECK(cloam_with({"export", run.string(), "-o", file.string(), "-q"}).code == 0);
  CHECK(viewer.get(scene["splats"]).body == content_of(file));
  const Json frame = frame_of(scene["cameras"][0], 24, 24);
  CHECK((viewer.post("frame", frame).body == rendered(run, frame, "of_splats")));
}

namespace {

/// Files and record of a run, without the words of the command, which name another folder.
std::pair<std::map<std::string, std::string>, Json> without_words(const fs::path& run) {
  std::map<std::string, std::string> files = snapshot(run);
  Json record = json_of(run / "run.json");
  record.erase("command_line");
  std::erase_if(files, [](const auto& file) { return file.first.ends_with("run.json"); });
  return {files, record};
}

std::vector<Json> actors_with_boxes(const Viewer& viewer, double time) {
  std::vector<Json> found;
  const Json all = viewer.get("actors?time=" + std::to_string(time)).json();
  for (const Json& actor : all["actors"])
    if (!actor["box"].is_null()) found.push_back(actor);
  return found;
}

/// In the world, of a shift along the actor's own axes.
Json in_world(const Json& actor, const Eigen::Vector3d& shift) {
  Json out = Json::array();
  for (std::size_t row = 0; row < 3; ++row) {
    double sum = 0;
    for (std::size_t i = 0; i < 3; ++i)
      sum += actor["box"]["world_from_box"][4 * row + i].get<double>() * shift[static_cast<int>(i)];
    out.push_back(sum);
  }
  return out;
}

}  // namespace

TEST_CASE("view: edits are those of edit: the same run, the same pixels") {
  const fs::path run = two_streets_run(), saved = scratch() / "saved", typed = scratch() / "typed";
  Viewer viewer({run.string(), "--log", "1", "--prior", small_diffusion_run().string()});
  const Json scene = viewer.get("scene.json").json();
  CHECK(scene["street"] == true);
  const Json camera = scene["cameras"][1], frame = frame_of(camera, 48, 27);
  const double time = camera["time"];
  const std::vector<Json> actors = actors_with_boxes(viewer, time);
  REQUIRE(actors.size() >= 5);
  const auto id = [&](std::size_t i) { return actors[i]["id"].get<std::string>(); };
  const std::string before = viewer.post("frame", frame).body;
  const auto edit = [&](const Json& words) {
    const Reply reply = viewer.post("edit", words);
    CHECK_MESSAGE(reply.status == 200, reply.body);
  };
  CHECK(viewer.post("save", Json{{"path", saved.string()}}).status == 409);  // nothing to save
  edit({{"op", "move"}, {"id", id(0)}, {"shift", in_world(actors[0], {1.5, -2, 0.25})}, {"time", time}});
  edit({{"op", "turn"}, {"id", id(0)}, {"degrees", 33.3}});
  edit({{"op", "exchange"}, {"id", id(1)}, {"asset", id(2)}});
  edit({{"op", "hide"}, {"id", id(3)}});
  edit({{"op", "hide"}, {"id", id(4)}});
  CHECK(viewer.post("edit", Json{{"op", "turn"}, {"id", id(4)}, {"degrees", 1}}).status == 409);  // hidden
  edit({{"op", "show"}, {"id", id(4)}});
  edit({{"op", "move"}, {"id", id(4)}, {"shift", {50, 0, 0}}});
  CHECK(viewer.post("undo").status == 200);
  std::string of_class;  // an actor of a class that the prior has seen
  for (const Json& actor : actors) {
    if (!of_class.empty() || actor["id"] == id(0) || actor["id"] == id(3)) continue;
    const Reply reply = viewer.post("edit", Json{{"op", "generate"}, {"id", actor["id"]}, {"seed", 7}});
    if (reply.status == 200) of_class = actor["id"];
  }
  REQUIRE(!of_class.empty());
  const Reply after = viewer.post("frame", with(frame, {{"number", 2}}));
  REQUIRE(after.status == 200);
  CHECK(after.body != before);
  REQUIRE(viewer.post("save", Json{{"path", saved.string()}}).status == 200);
  CHECK(viewer.post("save", Json{{"path", saved.string()}}).status == 200);  // again, its own
  const auto untouched = snapshot(run);
  for (const std::string& other : {run.string(), scratch().string(), std::string(), small_ply().string()})
    CHECK(viewer.post("save", Json{{"path", other}}).status >= 400);
  CHECK(snapshot(run) == untouched);

  const Outcome edited =
      cloam_with({"edit", run.string(), "--actor", id(0) + ":shift=1.5,-2,0.25,rotate=33.3", "--actor",
                  id(1) + ":replace=" + id(2), "--actor", id(3) + ":remove", "--actor", of_class + ":replace=generated",
                  "--seed", "7", "--prior", small_diffusion_run().string(), "-o", typed.string(), "-q"});
  REQUIRE_MESSAGE(edited.code == 0, edited.err);
  CHECK(without_words(saved) == without_words(typed));
  CHECK((after.body == rendered(typed, with(frame, {{"log", 1}}), "of_edited")));

  while (viewer.post("undo").status == 200) {}
  CHECK(viewer.post("frame", with(frame, {{"number", 3}})).body == before);
  CHECK(viewer.get("scene.json").json()["can_undo"] == false);
}

TEST_CASE("view: actors are picked, drawn small, and seen beside what was recorded") {
  Viewer viewer({small_street_run().string()});
  const Json scene = viewer.get("scene.json").json(), camera = scene["cameras"][0];
  const double time = camera["time"];
  CHECK(scene["times"][0] == time);
  const Reply sweep = viewer.get("lidar?time=" + std::to_string(time));
  CHECK(sweep.status == 200);
  CHECK(sweep.body.size() % 12 == 0);
  CHECK(sweep.body.size() > 1200);
  const std::vector<Json> actors = actors_with_boxes(viewer, time);
  REQUIRE(!actors.empty());
  const Reply small = viewer.get(actors[0]["thumbnail"]);
  CHECK(small.status == 200);
  CHECK(small.header("Content-Type") == "image/jpeg");
  CHECK(viewer.get("thumbnails/0-99-1-1-1").status == 404);
  // From 3 m above, straight down onto the middle of its box.
  const Json centre = actors[0]["box"]["centre"];
  Json above = frame_of(camera, 32, 32);
  above["world_from_camera"] = {1, 0, 0, centre[0], 0, -1, 0, centre[1], 0, 0, -1, centre[2].get<double>() + 3};
  CHECK(viewer.post("pick", with(above, {{"x", 16}, {"y", 16}})).json()["id"] == actors[0]["id"]);
  Json up = above;
  up["world_from_camera"] = {1, 0, 0, centre[0], 0, 1, 0, centre[1], 0, 0, 1, centre[2].get<double>() + 100};
  CHECK(viewer.post("pick", with(up, {{"x", 16}, {"y", 16}})).json()["id"].is_null());
  for (const Json& bad : std::vector<Json>{{{"op", "mvoe"}, {"id", actors[0]["id"]}},
                                           {{"op", "hide"}, {"id", "nobody"}},
                                           {{"op", "hide"}},
                                           {{"op", "move"}, {"id", actors[0]["id"]}, {"shift", {1, 2}}},
                                           {{"op", "move"}, {"id", actors[0]["id"]}, {"shift", {1e9, 0, 0}}},
                                           {{"op", "turn"}, {"id", actors[0]["id"]}, {"degrees", "a lot"}},
                                           {{"op", "generate"}, {"id", actors[0]["id"]}, {"seed", -1}},
                                           {{"op", "exchange"}, {"id", actors[0]["id"]}, {"asset", "nobody"}}}) {
    CAPTURE(bad.dump());
    CHECK(viewer.post("edit", bad).status == 400);
  }
  CHECK(viewer.get("scene.json").json()["can_undo"] == false);
}

TEST_CASE("train --view: a training that is followed makes the same bytes") {
  const fs::path alone = scratch() / "alone", followed = scratch() / "followed";
  const Words steps = {"--steps", "40", "--seed", "3"};
  const Outcome plain = cloam_with(small_training(small_scene(), alone, steps));
  REQUIRE_MESSAGE(plain.code == 0, plain.err);
  Words words = small_training(small_scene(), followed, steps);
  words.push_back("--view");
  Process process(words);
  std::string address;
  for (int i = 0; i < 3000 && address.empty() && process.running(); ++i) {
    const std::string err = process.said();
    const std::size_t at = err.find("http://127.0.0.1:");
    if (at != std::string::npos && err.find('\n', at) != std::string::npos)
      address = err.substr(at, err.find('\n', at) - at);
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  REQUIRE(!address.empty());
  const std::size_t path = address.find('/', std::string("http://").size());
  httplib::Client client(address.substr(0, path));
  client.set_read_timeout(60, 0);
  const auto scene = client.Get(address.substr(path) + "scene.json");
  REQUIRE(scene);
  REQUIRE(scene->status == 200);
  const Json shown = Json::parse(scene->body);
  CHECK(shown["training"]["steps"] == 40);
  int frames = 0;
  for (int number = 1; number < 1000; ++number) {
    const Json frame = with(frame_of(shown["cameras"][0], 24, 24), {{"number", number}, {"level", number % 3}});
    const auto reply = client.Post(address.substr(path) + "frame", frame.dump(), "application/json");
    if (!reply || reply->status != 200) break;
    ++frames;
  }
  CHECK(frames > 0);
  const Outcome ended = process.wait();
  CHECK_MESSAGE(ended.code == 0, ended.err);
  CHECK(content_of(followed / "ckpt" / "000040.safetensors") == content_of(alone / "ckpt" / "000040.safetensors"));
}
