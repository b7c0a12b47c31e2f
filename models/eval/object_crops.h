// The objects of driving logs as pictures of their own: what generated assets are compared with, and classifiers learn
// from. Files and keys are documented in docs/formats.md.
#pragma once
#include <array>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "models/data/object_views.h"
#include "models/io/image.h"
#include "models/runs/captures.h"
#include "models/runs/listener.h"

namespace cloam {

struct CropRequest {
  std::vector<std::string> logs = {};
  std::string out = {};
  std::string masks = {};     // folder of masks from elsewhere; empty: the logs' truth
  std::string split = "all";  // train, test or all
  Reading how = {};           // protocol or holdout, and what is allowed
  int size = 256;             // of the crops, pixels a side
  ObjectFilters filters = {};
};

struct OutcomeCounts {
  std::array<std::size_t, kObjectOutcomes> of = {};  // by ObjectOutcome
  std::size_t without_lidar = 0;                     // of those kept, without a point in the image

  std::size_t kept() const { return of[0]; }
  std::size_t all() const;
  void add(const ObjectView& object);
};

struct CropReport {
  std::size_t images = 0, mask_files = 0;  // mask_files: images whose masks come from files
  std::size_t other = 0;                   // objects of no class of Table A1
  std::array<OutcomeCounts, kAssetClassCount> classes;
};

/// The object on its own, square.width() pixels a side: pixels of the mask have the photo's colour and alpha, all
/// others are 0.
Image cut_out(const FramePixels& photo, const ActorMask& mask, const ObjectView& object);

/// Writes the crops of all logs and, at the end, crops.json into request.out, which must be new. All logs are read
/// before anything is written. Fault::usage for captures that are no logs, for two logs of one name and parent and for
/// a split without images; Fault::data where no log has an actor, and for files that are damaged.
CropReport write_crops(const CropRequest& request, const Listener& listener);

/// Counts as crops.json and --json have them.
nlohmann::ordered_json to_json(const CropReport& report);
/// The same as a table.
std::string table_of(const CropReport& report, const ObjectFilters& filters);

}  // namespace cloam
