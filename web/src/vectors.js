// Vectors of three numbers, rotations as three rows, poses as twelve numbers: three rows of [rotation | position],
// world_from_camera, x right, y down, z forward.

export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const times = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const length = (a) => Math.hypot(...a);
export const unit = (a) => times(a, 1 / Math.max(1e-30, length(a)));

/** v turned about a unit axis (Rodrigues). */
export function turned(v, axis, angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return add(add(times(v, c), times(cross(axis, v), s)), times(axis, dot(axis, v) * (1 - c)));
}

/** Column k of a pose: 0 right, 1 down, 2 forward, 3 position. */
export const column = (pose, k) => [pose[k], pose[4 + k], pose[8 + k]];

export function poseOf(right, down, forward, position) {
  return [0, 1, 2].flatMap((row) => [right[row], down[row], forward[row], position[row]]);
}

/** pose * (x, y, z, 1). */
export const moved = (pose, v) => [0, 4, 8].map((r) => pose[r] * v[0] + pose[r + 1] * v[1] + pose[r + 2] * v[2] + pose[r + 3]);

/** A point of the world in the axes of a pose. */
export function seenFrom(pose, point) {
  const d = minus(point, column(pose, 3));
  return [dot(d, column(pose, 0)), dot(d, column(pose, 1)), dot(d, column(pose, 2))];
}

/** w, x, y, z. */
export function quaternionOf(pose) {
  const [m00, m01, m02, , m10, m11, m12, , m20, m21, m22] = pose;
  const q = [1 + m00 + m11 + m22, 1 + m00 - m11 - m22, 1 - m00 + m11 - m22, 1 - m00 - m11 + m22]
    .map((square) => Math.sqrt(Math.max(0, square)) / 2);
  const signed = (value, by) => (by < 0 ? -value : value);
  // Signs relative to the largest part, which is known best.
  const largest = q.indexOf(Math.max(...q));
  const pairs = [
    [1, m21 - m12, m02 - m20, m10 - m01], [m21 - m12, 1, m10 + m01, m02 + m20],
    [m02 - m20, m10 + m01, 1, m21 + m12], [m10 - m01, m02 + m20, m21 + m12, 1]];
  return q.map((value, i) => signed(value, pairs[largest][i]));
}

export function poseFrom(quaternion, position) {
  const norm = Math.hypot(...quaternion);
  const [w, x, y, z] = quaternion.map((value) => value / norm);
  return [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), position[0],
    2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x), position[1],
    2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y), position[2]];
}
