// The photos that an evaluation measures, one scene of the run at a time.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "models/data/load_images.h"
#include "models/runs/listener.h"
#include "models/runs/restore_run.h"

namespace cloam {

struct EvalRequest {
  std::string run = {}, other = {};
  std::string images = {};                // folder for the pictures (default RUN/eval/images)
  std::string protocol = {};              // empty: the run's own
  std::string features = {};              // weights of a feature network, or "random"; empty: no feature distances
  std::string photos = {};                // crops that a diffusion's samples are held against; empty: none
  std::string lpips = {};                 // weights of LPIPS, "BACKBONE,LINEAR"; empty: no LPIPS
  std::optional<std::size_t> scene = {};  // of the run: that one alone
  bool allow_outside = false;             // as Reading has it, over what the run says
  std::optional<int> downscale = {};      // how far photos are shrunk; nothing: as for the training
};

struct Photos {
  int index = 0;     // of the run's scenes
  std::string name;  // of the folder
  std::string protocol;
  std::string image;         // of a run on one image, that one
  Scene scene, train_scene;  // of the photos that are measured, and of those that guesses are made from
  Pixels measured, train;
  LoadOptions options;
};

/// The protocol that is measured: the one asked for, else the run's own; empty: what the run held out.
std::string protocol_of(const RestoredRun& run, const EvalRequest& request);

/// Places among the run's scenes.
std::vector<std::size_t> scenes_to_measure(const RestoredRun& run, const EvalRequest& request);

/// With --data: data of the fingerprint of one of the run's scenes are that scene's, in another place. Then the request
/// becomes one for that scene without --data, and the record in memory names the new place. Fault::data.
void take_own_data(RestoredRun& run, EvalRequest& request, const Listener& listener);

/// The run's own photos: those that the protocol measures or that the run held out, else those it was trained on.
/// With --data those of another folder in the same coordinates, of which it takes the test split, else all. The guesses
/// are always made from the run's own training photos. Cameras have the lenses, and the run's own photos
/// the poses, that it learned. Tells what is odd as warnings.
Photos photos_of(const RestoredRun& run, const EvalRequest& request, std::size_t index, const Listener& listener);

/// Photos of `scene` get the lenses that the run learned of their cameras. index: of the run's scene, whose cameras are
/// known by their numbers; others stay as given. How many photos have such.
std::size_t take_learned_lenses(const RestoredRun& run, const Scene& scene, int index, Pixels& photos);

}  // namespace cloam
