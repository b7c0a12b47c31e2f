// A Recording as JSON: meta/recording.json of a log in PandaSet's layout, and "recording" in a run's scene.json.
#pragma once
#include "models/io/json.h"
#include "models/scene/recording.h"

namespace cloam {

constexpr const char* kRecordingFile = "meta/recording.json";  // of a log

/// Keys whose values are the defaults are left out.
Json to_json(const Recording& recording);
/// Fault::data, with `where` at its head, for values that no log has.
Recording recording_from(const Json& json, const std::string& where);

/// PandaSet's own car and clock.
Recording pandaset_recording();

}  // namespace cloam
