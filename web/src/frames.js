// Pictures that the program renders for the mouse's camera: coarse ones while it moves, one at a time; then finer ones.
// What is no longer wanted is dropped, here and in the program.

const kStill = 120; // milliseconds without a movement
const kLevels = 3;

export class Frames {
  /** shown({scale, milliseconds, level}) after each picture; view(): what to ask for; failed(error). */
  constructor(canvas, server, { view, shown, failed }) {
    Object.assign(this, { canvas, server, view, shown, failed });
    this.client = crypto.getRandomValues(new Uint32Array(2)).join('-');
    this.number = 0;
    this.stale = false; // a movement waits for its coarse picture
    this.level = kLevels; // of the next picture while nothing moves
    this.flight = null;
  }

  /** The camera, the time or the scene is another one. */
  changed(moves = true) {
    this.stale = true;
    this.level = moves ? 1 : 0;
    this.movedAt = moves ? performance.now() : 0;
    if (this.flight && this.flight.level > 0) this.flight.stop.abort();
    this.pump();
  }

  get moving() { return performance.now() - this.movedAt < kStill; }
  get finished() { return !this.flight && !this.stale && this.level >= kLevels; }

  pump() {
    clearTimeout(this.timer);
    if (this.flight) return;
    if (this.stale) return void this.fetch(0);
    if (this.level >= kLevels) return;
    if (this.moving) this.timer = setTimeout(() => this.pump(), kStill);
    else this.fetch(this.level);
  }

  async fetch(level) {
    this.stale = false;
    if (level === 0) this.level = 1;
    const flight = { level, stop: new AbortController() };
    this.flight = flight;
    try {
      const request = { client: this.client, number: ++this.number, level, ...this.view() };
      const answer = await this.server.post('frame', request, flight.stop.signal);
      const picture = await createImageBitmap(await answer.blob());
      if (level === 0 || !this.stale) this.show(picture, level, answer.headers);
    } catch (error) {
      const dropped = error.name === 'AbortError' || error.status === 409;
      if (!dropped) { this.level = kLevels; this.failed(error); }
      else if (!this.stale) this.level = Math.min(this.level, level); // another's edit dropped it: ask again
    }
    this.flight = null;
    this.pump();
  }

  show(picture, level, headers) {
    const { width, height } = this.view();
    const scale = Number(headers.get('X-Scale') ?? 1);
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    const context = this.canvas.getContext('2d');
    context.imageSmoothingQuality = 'high';
    context.drawImage(picture, 0, 0, width, height);
    picture.close();
    this.level = scale === 1 ? kLevels : Math.max(this.level, level + 1);
    this.shown({ scale, level, milliseconds: Number(headers.get('X-Milliseconds') ?? NaN) });
  }
}
