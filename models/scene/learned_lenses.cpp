// See learned_lenses.h.
#include "models/scene/learned_lenses.h"

namespace cloam {

LearnedLenses lenses_of(const LearnedLenses& lenses, const Tensor& camera) {
  LearnedLenses out = lenses;
  for (Tensor* of : {&out.focals, &out.centres})
    if (*of) *of = gather_rows(*of, camera);
  return out;
}

Tensor directions_through(const LearnedLenses& lenses, const Tensor& directions) {
  Tensor across = slice(directions, 1, 0, 2);
  const Tensor ahead = slice(directions, 1, 2, 3);
  if (lenses.centres) across = across - lenses.centres * ahead;
  if (lenses.focals) across = across / lenses.focals;
  return concat({across, ahead}, 1);
}

Tensor views_through(const LearnedLenses& lens, const Tensor& views) {
  Tensor across = slice(views, 1, 0, 2);
  const Tensor ahead = slice(views, 1, 2, 3);
  if (lens.focals) across = across * lens.focals;
  if (lens.centres) across = across + reshape(lens.centres, {2, 1}) * ahead;
  return concat({across, ahead}, 1);
}

}  // namespace cloam
