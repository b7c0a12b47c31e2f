// The camera that the user moves: a pose, and the centre that it turns around, always straight ahead.
import { add, column, cross, dot, length, minus, moved, poseFrom, poseOf, quaternionOf, times, turned, unit } from './vectors.js';

const kFocal = 1.1; // of the picture's shorter side: some 49 degrees
const kSteepest = 0.05; // radians between the view and straight up or down

export class Camera {
  /** scene: up, centre, radius and cameras of scene.json. */
  constructor(scene) {
    this.scene = scene;
    this.up = unit(scene.up);
    this.reset();
  }

  reset() {
    if (this.scene.cameras.length) return this.jump(0);
    const aside = unit(cross(this.up, Math.abs(this.up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0]));
    const back = unit(add(aside, times(this.up, 0.4)));
    this.look(add(this.scene.centre, times(back, 2.5 * this.scene.radius)), this.scene.centre);
  }

  /** From a point towards another one, upright. */
  look(from, to) {
    const forward = unit(minus(to, from)), right = unit(cross(forward, this.up));
    this.pose = poseOf(right, cross(forward, right), forward, from);
    this.distance = length(minus(to, from));
    this.focal = kFocal;
    this.recorded = null;
  }

  /** To recorded camera number `index`, whose picture is shown whole. */
  jump(index) {
    const camera = this.scene.cameras[index];
    this.pose = [...camera.world_from_camera];
    const ahead = dot(minus(this.scene.centre, column(this.pose, 3)), column(this.pose, 2));
    this.distance = Math.max(ahead, 0.1 * this.scene.radius);
    this.focal = camera.fy / Math.min(camera.width, camera.height);
    this.recorded = index;
  }

  get centre() { return add(column(this.pose, 3), times(column(this.pose, 2), this.distance)); }

  /** What `frame` asks for: a pinhole of this size at this place. */
  view(width, height) {
    const view = { width, height, world_from_camera: this.pose };
    const camera = this.recorded === null ? null : this.scene.cameras[this.recorded];
    if (camera) {
      const { scale, left, top } = this.recordedPlace(width, height);
      return { ...view, fx: camera.fx * scale, fy: camera.fy * scale, cx: left + camera.cx * scale, cy: top + camera.cy * scale };
    }
    const focal = this.focal * Math.min(width, height);
    return { ...view, fx: focal, fy: focal, cx: width / 2, cy: height / 2 };
  }

  /** Where the recorded picture lies in a view of this size. */
  recordedPlace(width, height) {
    const camera = this.scene.cameras[this.recorded], scale = Math.min(width / camera.width, height / camera.height);
    return { scale, left: (width - scale * camera.width) / 2, top: (height - scale * camera.height) / 2 };
  }

  /** Turns everything about the centre. */
  orbit(aroundUp, aroundRight) {
    const centre = this.centre;
    let [right, , forward] = [0, 1, 2].map((k) => column(this.pose, k));
    const steep = Math.acos(Math.min(1, Math.max(-1, dot(forward, this.up))));
    const least = kSteepest - steep, most = Math.PI - kSteepest - steep; // turning by x makes the angle to up larger by -x
    const about = -Math.min(Math.max(-aroundRight, Math.min(least, 0)), Math.max(most, 0));
    forward = turned(turned(forward, right, about), this.up, aroundUp);
    right = turned(right, this.up, aroundUp);
    right = unit(minus(right, times(forward, dot(right, forward))));
    this.pose = poseOf(right, cross(forward, right), unit(forward), minus(centre, times(unit(forward), this.distance)));
    this.recorded = null;
  }

  /** Moves camera and centre along the camera's axes: right, down, forward, in scene units. */
  shift(right, down, forward) {
    const by = add(add(times(column(this.pose, 0), right), times(column(this.pose, 1), down)), times(column(this.pose, 2), forward));
    const position = add(column(this.pose, 3), by);
    this.pose = this.pose.map((value, i) => (i % 4 === 3 ? position[(i - 3) / 4] : value));
    this.recorded = null;
  }

  /** Towards the centre (factor below 1) or away from it. */
  zoom(factor) {
    const next = Math.max(this.distance * factor, 1e-3 * this.scene.radius);
    this.shift(0, 0, this.distance - next);
    this.distance = next;
  }

  /** Puts the point that is seen at x, y, as far away as the centre, in the middle. */
  recentre(x, y, width, height) {
    const view = this.view(width, height);
    this.shift((x - view.cx) / view.fx * this.distance, (y - view.cy) / view.fy * this.distance, 0);
  }

  /** The ray through a pixel: origin and direction in the world. */
  ray(x, y, width, height) {
    const view = this.view(width, height), origin = column(this.pose, 3);
    return { origin, direction: unit(minus(moved(this.pose, [(x - view.cx) / view.fx, (y - view.cy) / view.fy, 1]), origin)) };
  }

  /** For the address: a reload brings the same view back. */
  toWords() {
    if (this.recorded !== null) return `camera=${this.recorded}`;
    const numbers = [...column(this.pose, 3), ...quaternionOf(this.pose), this.distance, this.focal];
    return 'view=' + numbers.map((n) => +n.toPrecision(7)).join(',');
  }

  /** False for words that are none of ours. */
  fromWords(words) {
    const recorded = Number(words.get('camera') ?? NaN);
    if (Number.isInteger(recorded) && this.scene.cameras[recorded]) { this.jump(recorded); return true; }
    const numbers = (words.get('view') ?? '').split(',').map(Number);
    if (numbers.length !== 9 || !numbers.every(Number.isFinite) || numbers[7] <= 0 || numbers[8] <= 0) return false;
    if (Math.hypot(...numbers.slice(3, 7)) < 1e-6) return false;
    this.pose = poseFrom(numbers.slice(3, 7), numbers.slice(0, 3));
    [this.distance, this.focal] = numbers.slice(7);
    this.recorded = null;
    return true;
  }
}
