// See view_html.h.
#include "cli/view_html.h"

#include <nlohmann/json.hpp>

#include "cli/page.h"
#include "cli/view_page.h"
#include "cli/view_scene.h"
#include "models/gaussians/spz.h"
#include "models/gaussians/turn.h"
#include "models/io/commit.h"
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;
using Report = nlohmann::ordered_json;

constexpr char kPlace[] = "<!-- data -->", kRenderer[] = "var cloamSplats";
constexpr int kNewest = 3;  // of .spz

/// As an element of the page: no word of it can end the element early.
std::string stored_scene(const Report& scene) {
  std::string json = scene.dump(-1, ' ', false, Report::error_handler_t::replace), safe;
  for (const char c : json) safe += c == '<' ? "\\u003c" : std::string(1, c);
  return "<script type=\"application/json\" id=\"stored-scene\">" + safe + "</script>\n";
}

/// What only a program answers.
void leave_out_questions(Report& scene) {
  scene["street"] = scene["lidar"] = scene["can_undo"] = scene["can_save"] = false;
  scene["training"] = nullptr;
  for (Report& camera : scene["cameras"]) camera["photo"] = nullptr;
}

std::string stored_gaussians(const Gaussians& gaussians, Report& scene, const fs::path& path) {
  Eigen::Matrix4d world_from_splats = Eigen::Matrix4d::Identity();
  world_from_splats.topLeftCorner<3, 3>() =
      turn_between(gaussians.up.normalized(), Eigen::Vector3d::UnitY()).transpose();
  scene["splats"] = "splats.spz";
  scene["world_from_splats"] = pose_json(world_from_splats);
  return stored_scene(scene) + "<script type=\"text/plain\" id=\"stored-splats\">" +
         base64(spz_bytes(gaussians, kNewest, path.string())) + "</script>\n";
}

std::string stored_tour(Shown& shown, Report& scene, const Listener& listener) {
  const std::vector<View> views = shown.tour();
  Report tour = Report::array();
  for (const View& view : views) {
    listener.check_stop([] { return std::string("nothing was written"); });
    FrameRequest request;
    request.level = 2;
    request.view = view;
    const Answer frame = shown.frame(request, [] {});
    tour.push_back(
        {{"world_from_camera", pose_json(view.world_from_camera)},
         {"time", view.time},
         {"picture", text("data:", frame.type, ";base64,",
                          base64({reinterpret_cast<const std::uint8_t*>(frame.body.data()), frame.body.size()}))}});
    listener.say(text("picture ", tour.size(), " of ", views.size()));
  }
  scene["tour"] = std::move(tour);
  return stored_scene(scene);
}

}  // namespace

std::uintmax_t write_view_html(const fs::path& path, Shown& shown, const Listener& listener) {
  const std::string page = viewer_page();
  Report scene = Report::parse(shown.scene().body);
  leave_out_questions(scene);
  const bool has_gaussians = !scene["splats"].is_null();
  if (has_gaussians && page.find(kRenderer) == std::string::npos)
    throw Error(Fault::usage,
                "--html: this cloam was built without npm, so its page cannot draw Gaussians by itself\n"
                "  fix: install npm and run script/setup again; or cloam export RUN -o FILE.spz for another viewer");
  const std::string data =
      has_gaussians ? stored_gaussians(shown.gaussians(), scene, path) : stored_tour(shown, scene, listener);
  const std::size_t place = page.find(kPlace);
  commit_text(path, page.substr(0, place) + data + page.substr(place + sizeof kPlace - 1));
  return fs::file_size(path);
}

}  // namespace cloam
