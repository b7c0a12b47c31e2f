// See view_shown.h.
#include "cli/view_shown.h"

#include <nlohmann/json.hpp>

#include "models/gaussians/gaussian_ply.h"

namespace cloam {
namespace {

Refused no(const char* what) { return {404, what}; }

constexpr char kNoActors[] = "there are no actors here: they are those of a run on driving logs";

}  // namespace

Gaussians Shown::gaussians() const { throw no("there are no Gaussians here: frames are rendered"); }
Answer Shown::frame(const FrameRequest&, const std::function<void()>&) {
  throw no("no frames are rendered of a file: splats.ply has its Gaussians");
}
Answer Shown::actors(double) { throw no(kNoActors); }
Answer Shown::thumbnail(const std::string&) { throw no(kNoActors); }
Answer Shown::pick(const Json&) { throw no(kNoActors); }
Answer Shown::edit(const Json&) { throw no(kNoActors); }
Answer Shown::undo() { throw no(kNoActors); }
Answer Shown::save(const Json&) { throw no(kNoActors); }
Answer Shown::photo(std::size_t) { throw no("there are no photos here"); }
Answer Shown::lidar(double) { throw no("there are no LiDAR sweeps here"); }

Answer json_answer(const nlohmann::ordered_json& json) {
  return {json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n"};
}

Answer ply_answer(const Gaussians& gaussians) {
  std::string bytes;
  write_gaussian_ply(gaussians, [&](std::span<const std::byte> part) {
    bytes.append(reinterpret_cast<const char*>(part.data()), part.size());
  });
  return {std::move(bytes), "application/octet-stream"};
}

}  // namespace cloam
