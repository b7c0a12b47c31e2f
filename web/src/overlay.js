// What is drawn over the picture: boxes of actors, points of the LiDAR, the recorded photo.
import { moved, seenFrom } from './vectors.js';

const kNear = 0.05;
const kEdges = [[0, 1], [1, 3], [3, 2], [2, 0], [4, 5], [5, 7], [7, 6], [6, 4], [0, 4], [1, 5], [2, 6], [3, 7]];
const kFront = [[2, 7], [3, 6]]; // a cross on the face that looks ahead (y)

/** The pixel where a point of the world is seen; null behind the camera. */
export function pixelOf(view, point) {
  const [x, y, z] = seenFrom(view.world_from_camera, point);
  return z > kNear ? [view.fx * x / z + view.cx, view.fy * y / z + view.cy] : null;
}

export function cornersOf(box) {
  return Array.from({ length: 8 }, (_, i) =>
    moved(box.world_from_box, [i & 1 ? 1 : -1, i & 2 ? 1 : -1, i & 4 ? 1 : -1].map((side, k) => side * box.size[k] / 2)));
}

/** The rectangle that a box covers in the picture; null where it is not wholly ahead. */
export function extentOf(view, box) {
  const seen = cornersOf(box).map((corner) => pixelOf(view, corner));
  if (seen.some((pixel) => !pixel)) return null;
  const xs = seen.map((p) => p[0]), ys = seen.map((p) => p[1]);
  return { left: Math.min(...xs), right: Math.max(...xs), top: Math.min(...ys), bottom: Math.max(...ys) };
}

/** A segment between points of the world, cut where it passes behind the camera. */
function line(context, view, from, to) {
  let a = seenFrom(view.world_from_camera, from), b = seenFrom(view.world_from_camera, to);
  if (a[2] < kNear && b[2] < kNear) return;
  if (a[2] > b[2]) [a, b] = [b, a];
  if (a[2] < kNear) {
    const share = (kNear - a[2]) / (b[2] - a[2]);
    a = a.map((value, k) => value + share * (b[k] - value));
  }
  context.moveTo(view.fx * a[0] / a[2] + view.cx, view.fy * a[1] / a[2] + view.cy);
  context.lineTo(view.fx * b[0] / b[2] + view.cx, view.fy * b[1] / b[2] + view.cy);
}

export function drawBox(context, view, box, { colour, width, dashed }) {
  const corners = cornersOf(box);
  context.beginPath();
  for (const [a, b] of [...kEdges, ...kFront]) line(context, view, corners[a], corners[b]);
  for (const [style, wide] of [['rgba(0,0,0,.6)', width + 2], [colour, width]]) { // seen on bright and on dark
    Object.assign(context, { strokeStyle: style, lineWidth: wide, lineJoin: 'round' });
    context.setLineDash(dashed ? [6, 5] : []);
    context.stroke();
  }
  context.setLineDash([]);
}

/** points: Float32Array of triples; coloured by their height over the lowest: blue, green, yellow, red. */
export function drawPoints(context, view, points, up) {
  const size = Math.max(1, Math.round(view.height / 400));
  const { heights, low, high } = heightsOf(points, up);
  for (let i = 0; i < heights.length; ++i) {
    const pixel = pixelOf(view, [points[3 * i], points[3 * i + 1], points[3 * i + 2]]);
    if (!pixel || pixel[0] < 0 || pixel[1] < 0 || pixel[0] > view.width || pixel[1] > view.height) continue;
    const share = Math.min(1, Math.max(0, (heights[i] - low) / (high - low)));
    context.fillStyle = `hsl(${240 - 240 * share} 100% 55%)`;
    context.fillRect(pixel[0] - size / 2, pixel[1] - size / 2, size, size);
  }
}

/** Between the heights that leave out the lowest and highest fiftieth: one bird shall not make all else blue. */
function heightsOf(points, up) {
  const heights = Float32Array.from({ length: points.length / 3 },
    (_, i) => points[3 * i] * up[0] + points[3 * i + 1] * up[1] + points[3 * i + 2] * up[2]);
  const sorted = Float32Array.from(heights).sort();
  const low = sorted[Math.floor(0.02 * sorted.length)] ?? 0, high = sorted[Math.floor(0.98 * sorted.length)] ?? 1;
  return { heights, low, high: Math.max(high, low + 1e-6) };
}
