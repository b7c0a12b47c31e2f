// Gaussians that the browser draws itself: the same face as Frames (frames.js).

const kSettled = 200; // milliseconds without a movement

export class SplatView {
  /** splats: of createSplats (web/splats.js). */
  constructor(splats, { view, shown }) {
    Object.assign(this, { splats, view, shown, wanted: false });
  }

  changed(moves = true) {
    if (moves) {
      this.movedAt = performance.now();
      clearTimeout(this.timer);
      this.timer = setTimeout(() => this.changed(false), kSettled);
    }
    if (this.wanted) return;
    this.wanted = true;
    requestAnimationFrame(() => {
      this.wanted = false;
      this.last = this.splats.draw(this.view(), this.moving);
      this.shown({ ...this.last, level: this.last.scale === 1 ? 2 : 0 });
    });
  }

  get moving() { return performance.now() - this.movedAt < kSettled; }
  get finished() { return !this.wanted && !this.moving && this.splats.sorted(); }
}
