// Capability: learns from what another run has learned, in the place of captures. build() is given that run's scenes.
#pragma once
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "models/io/safetensors.h"
#include "models/scene/scene.h"

namespace cloam {

struct SourceRun {
  std::filesystem::path folder;
  std::string method;
  std::map<std::string, std::string> settings;  // all of them
  std::optional<std::string> edited_from;       // of an edited run: the run that it was made from
  const Scenes& scenes;
  TensorMap parameters, row_steps;  // row_steps: of sparse parameters, the steps that trained each row
};

class LearnsFromRun {
 public:
  virtual ~LearnsFromRun() = default;
  /// The settings that follow from the run. Fault::data for a run that has nothing to learn from.
  virtual std::map<std::string, std::string> settings_from(const SourceRun& source) const = 0;
  /// After build. Fault::data if there is too little.
  virtual void load(const SourceRun& source) = 0;
  /// What was loaded, one line each; and what is odd about it.
  virtual std::vector<std::string> describe() const = 0;
  virtual std::vector<std::string> warnings() const = 0;
};

}  // namespace cloam
