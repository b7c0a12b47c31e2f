// The clock and the rig of a real log, for made streets: docs/formats.md, `synth --as-recorded`.
#pragma once
#include "models/scene/recording.h"
#include "models/synth/street_log.h"
#include "models/synth/street_sensors.h"

namespace cloam {

/// What the reader has to know of a log of these options: the defaults for one whose sensors all see at once.
Recording recording_of(const StreetLogOptions& options);

/// Seconds after the middle of a sweep when a camera's middle row is exposed: as the LiDAR passes it, if staggered.
double exposed_after(const StreetLogOptions& options, const Mount& mount);

/// When the LiDAR that turns passes the middle of an actor during the sweep with this middle; the middle, if all of a
/// sweep is seen at once.
double seen_time(const MadeStreet& street, const StreetActor& actor, double middle, const Recording& recording);

/// Paints the rows of a picture that show the car itself.
void cover_rows(StreetPicture& picture, double share);

}  // namespace cloam
