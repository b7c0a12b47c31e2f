// Mouse, fingers and keys on the picture.

const kOrbit = 2 * Math.PI; // radians for a drag across the shorter side
const kStep = 0.04; // of the distance, for a frame with a key held
const kKeys = { w: [0, 0, 1], s: [0, 0, -1], a: [-1, 0, 0], d: [1, 0, 0], q: [0, 1, 0], e: [0, -1, 0],
  arrowup: [0, 0, 1], arrowdown: [0, 0, -1], arrowleft: [-1, 0, 0], arrowright: [1, 0, 0], pageup: [0, -1, 0], pagedown: [0, 1, 0] };

export class Controls {
  /**
   * stage: the element that is touched; camera(): the Camera; changed() after each movement; clicked(x, y);
   * grab(x, y): gives {move(x, y), drop()} where something else is dragged, or null.
   */
  constructor(stage, actions) {
    Object.assign(this, { stage, actions, fingers: new Map(), held: new Set() });
    stage.addEventListener('pointerdown', (event) => this.down(event));
    stage.addEventListener('pointermove', (event) => this.move(event));
    for (const kind of ['pointerup', 'pointercancel']) stage.addEventListener(kind, (event) => this.lift(event));
    stage.addEventListener('wheel', (event) => this.wheel(event), { passive: false });
    stage.addEventListener('contextmenu', (event) => event.preventDefault());
    stage.addEventListener('dblclick', (event) => {
      this.camera.recentre(...this.place(event), stage.clientWidth, stage.clientHeight);
      actions.changed();
    });
    window.addEventListener('keydown', (event) => this.key(event, true));
    window.addEventListener('keyup', (event) => this.key(event, false));
    window.addEventListener('blur', () => this.held.clear());
  }

  get camera() { return this.actions.camera(); }

  place(event) {
    const box = this.stage.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  down(event) {
    this.stage.setPointerCapture(event.pointerId);
    this.stage.focus({ preventScroll: true });
    const [x, y] = this.place(event);
    this.fingers.set(event.pointerId, { x, y });
    this.far = this.fingers.size > 1;
    this.begin = [x, y];
    this.grabbed = event.button === 0 && this.fingers.size === 1 ? this.actions.grab(x, y) : null;
  }

  move(event) {
    const finger = this.fingers.get(event.pointerId);
    if (!finger) return;
    const [x, y] = this.place(event), [dx, dy] = [x - finger.x, y - finger.y];
    if (Math.hypot(x - this.begin[0], y - this.begin[1]) > 4) this.far = true;
    if (!this.far) return; // a click shall not turn anything
    const before = this.spread();
    Object.assign(finger, { x, y });
    if (this.grabbed) return this.grabbed.move(x, y);
    if (this.fingers.size === 2) {
      const after = this.spread();
      if (before > 0 && after > 0) this.camera.zoom(before / after);
      this.pan(dx / 2, dy / 2);
    } else if (event.shiftKey || event.buttons & 6) {
      this.pan(dx, dy);
    } else {
      const per = kOrbit / Math.min(this.stage.clientWidth, this.stage.clientHeight) / 2;
      this.camera.orbit(-dx * per, -dy * per);
    }
    this.actions.changed();
  }

  lift(event) {
    if (!this.fingers.delete(event.pointerId)) return;
    if (this.grabbed) { this.grabbed.drop(this.far); this.grabbed = null; if (this.far) return; }
    if (!this.far && event.type === 'pointerup' && event.button === 0) this.actions.clicked(...this.place(event));
  }

  /** Between two fingers, in pixels. */
  spread() {
    const [a, b] = [...this.fingers.values()];
    return b ? Math.hypot(a.x - b.x, a.y - b.y) : 0;
  }

  pan(dx, dy) {
    const { fx, fy } = this.camera.view(this.stage.clientWidth, this.stage.clientHeight);
    this.camera.shift(-dx / fx * this.camera.distance, -dy / fy * this.camera.distance, 0);
  }

  wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 * event.deltaY : event.deltaMode === 2 ? 400 * event.deltaY : event.deltaY;
    this.camera.zoom(Math.exp(0.0015 * Math.max(-300, Math.min(300, lines))));
    this.actions.changed();
  }

  key(event, down) {
    const key = event.key.toLowerCase();
    if (!down) return void this.held.delete(key);
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest?.('input, select, textarea, button, dialog')) return;
    if (kKeys[key]) {
      event.preventDefault();
      const idle = this.held.size === 0;
      this.held.add(key);
      if (idle) this.fly();
    } else if (this.actions.keys[key]) {
      event.preventDefault();
      this.actions.keys[key]();
    }
  }

  /** While keys are held: as far in a second whatever the frame rate. */
  fly(then = performance.now() - 16) {
    if (this.held.size === 0) return;
    const now = performance.now(), step = kStep * this.camera.distance * Math.min(6, (now - then) / 16);
    const sum = [0, 1, 2].map((k) => [...this.held].reduce((total, key) => total + (kKeys[key]?.[k] ?? 0), 0));
    this.camera.shift(...sum.map((value) => value * step));
    this.actions.changed();
    requestAnimationFrame(() => this.fly(now));
  }
}
