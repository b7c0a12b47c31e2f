// Puts the page together: what is shown, when, and what the user is told.
import { Actors } from './actors.js';
import { Camera } from './camera.js';
import { Controls } from './controls.js';
import { element } from './element.js';
import { Frames } from './frames.js';
import { drawPoints } from './overlay.js';
import { Ended, Server, storedPage } from './server.js';
import { SplatView } from './splat_view.js';
import { Tour } from './tour.js';

const stage = element('stage');

class Page {
  constructor(scene, stored) {
    Object.assign(this, { scene, stored, time: scene.times?.[0] ?? 0, newest: scene.revision });
    this.server = new Server();
    this.server.onEnd = () => this.ended();
    this.camera = new Camera(scene);
    this.readAddress();
  }

  async start() {
    document.title = `${this.scene.title} – cloam view`;
    element('title').textContent = this.scene.title;
    element('method').textContent = this.scene.method ?? '';
    document.body.classList.toggle('closed', innerWidth <= 700);
    this.view = await this.makeView();
    this.addControls();
    this.addCameras();
    if (this.scene.times) this.addClock();
    if (this.scene.street && !this.stored) await this.addActors();
    this.showState();
    new ResizeObserver(() => this.changed(false)).observe(stage);
    if (!this.stored) this.server.listen((news) => this.hear(news));
    window.addEventListener('hashchange', () => { if (this.readAddress()) this.changed(); });
    this.changed(false);
  }

  size() { return [Math.max(1, stage.clientWidth), Math.max(1, stage.clientHeight)]; }
  seen() { return this.camera.view(...this.size()); }

  /** Gaussians are drawn here where the browser can; all else comes from the program. */
  async makeView() {
    const canvas = element('picture');
    const shown = (picture) => this.shown(picture), failed = (error) => this.failed(error);
    if (this.scene.tour) return new Tour(canvas, this.scene, { camera: () => this.camera, time: () => this.time, shown });
    if (this.scene.splats && globalThis.cloamSplats) {
      try {
        const bytes = this.stored ? this.stored.bytes('splats') : await this.download(this.scene.splats);
        this.splats = await globalThis.cloamSplats.createSplats(canvas, bytes, {
          ...this.scene, name: this.scene.splats, near: this.scene.near ?? 0.01 * this.scene.radius, changed: () => this.view?.changed(false) });
        return new SplatView(this.splats, { view: () => this.camera.view(...this.size().map((side) => Math.round(side * devicePixelRatio))), shown });
      } catch (error) {
        if (this.stored || !this.scene.method) throw error; // nobody else can draw it
        this.say(`This browser cannot draw Gaussians (${error.message}); the program draws them instead.`);
        const fresh = canvas.cloneNode();
        canvas.replaceWith(fresh);
        return this.frames(fresh, shown, failed);
      }
    }
    if (this.scene.splats && !this.scene.method)
      throw new Error('This cloam was built without npm, so its viewer cannot draw files of Gaussians.\nInstall npm, build again (script/setup), and start it anew.');
    return this.frames(canvas, shown, failed);
  }

  frames(canvas, shown, failed) {
    return new Frames(canvas, this.server, { view: () => ({ ...this.seen(), time: this.time }), shown, failed });
  }

  async download(path) {
    const done = this.busy('Loading the Gaussians …');
    try {
      return new Uint8Array(await (await this.server.ask(path)).arrayBuffer());
    } finally { done(); }
  }

  addControls() {
    const keys = {
      r: () => this.reset(), '?': () => element('help').showModal(), '[': () => this.step(-1), ']': () => this.step(1),
      ' ': () => this.play?.(), h: () => this.actors?.toggle(), u: () => this.actors?.undo(),
      g: () => { if (this.actors?.actor) this.actors.grab(!this.actors.grabbing); }, escape: () => this.actors?.pick(null),
    };
    new Controls(stage, {
      camera: () => this.camera, changed: () => this.moved(), keys,
      clicked: (x, y) => this.actors?.pickAt(this.seen(), x, y),
      grab: (x, y) => this.actors?.drag(x, y, this.size()) ?? null,
    });
    element('reset').onclick = keys.r;
    element('help-button').onclick = keys['?'];
    element('menu').onclick = () => {
      const closed = document.body.classList.toggle('closed');
      element('menu').setAttribute('aria-expanded', String(!closed));
    };
    element('menu').setAttribute('aria-expanded', String(!document.body.classList.contains('closed')));
    for (const id of ['opacity', 'lidar', 'boxes']) element(id).addEventListener('input', () => this.drawOver());
    element('lidar-row').hidden = !this.scene.lidar || Boolean(this.stored);
    element('boxes-row').hidden = !this.scene.street || Boolean(this.stored);
  }

  reset() { this.camera.reset(); this.moved(); }

  // Recorded cameras.

  addCameras() {
    const cameras = this.scene.cameras, list = element('cameras');
    if (!cameras.length || this.scene.tour) return;
    element('cameras-row').hidden = false;
    list.append(new Option('free view', ''), ...withoutCommon(cameras.map((camera) => camera.name)).map((name, i) => new Option(name, String(i))));
    list.onchange = () => { if (list.value !== '') this.jump(Number(list.value)); };
    element('previous').onclick = () => this.step(-1);
    element('next').onclick = () => this.step(1);
  }

  step(by) {
    const count = this.scene.cameras.length;
    if (count) this.jump((((this.camera.recorded ?? this.lastRecorded ?? -by) + by) % count + count) % count);
  }

  jump(index) {
    this.camera.jump(index);
    const time = this.scene.cameras[index].time;
    if (this.scene.times && Number.isFinite(time)) this.setTime(time);
    this.moved();
  }

  // Time.

  addClock() {
    const [first, last] = this.scene.times, slider = element('time');
    element('clock').hidden = false;
    element('follow-row').hidden = !this.scene.cameras.length || Boolean(this.scene.tour);
    Object.assign(slider, { min: first, max: last, value: this.time });
    slider.oninput = () => { this.setTime(Number(slider.value)); this.ride(); this.changed(); };
    this.play = () => {
      this.playing = !this.playing;
      element('play').textContent = this.playing ? '❚❚' : '▶';
      element('play').setAttribute('aria-label', this.playing ? 'Pause' : 'Play');
      if (this.playing) this.tick(performance.now());
    };
    element('play').onclick = this.play;
    this.setTime(this.time);
  }

  setTime(time) {
    this.time = time;
    element('time').value = time;
    element('seconds').textContent = `${(time - this.scene.times[0]).toFixed(1)} s`;
    this.actors?.refresh();
  }

  tick(then) {
    if (!this.playing) return;
    const now = performance.now(), [first, last] = this.scene.times;
    const next = this.time + (now - then) / 1000;
    this.setTime(next > last ? first : next);
    this.ride();
    this.changed();
    setTimeout(() => this.tick(now), 100);
  }

  /** To where the recording car was at this time. */
  ride() {
    if (!element('follow').checked) return;
    const cameras = this.scene.cameras, sensor = cameras[this.camera.recorded ?? this.lastRecorded ?? 0]?.sensor;
    let best = -1;
    cameras.forEach((camera, i) => {
      const off = Math.abs(camera.time - this.time);
      if (camera.sensor === sensor && (best < 0 || off < Math.abs(cameras[best].time - this.time))) best = i;
    });
    if (best >= 0) { this.camera.jump(best); this.showCamera(); }
  }

  // Actors.

  async addActors() {
    element('actors-section').hidden = false;
    this.actors = new Actors(this.server, this.scene, {
      camera: () => this.camera, time: () => this.time, changed: () => this.drawOver(), moved: () => this.moved(),
      failed: (error) => this.failed(error), said: (words) => this.say(words), busy: (words) => this.busy(words),
      done: (revision) => this.follow(revision) });
    await this.actors.refresh();
  }

  /** The answer to an edit and the event that all pages get tell of the same revision. */
  follow(revision) {
    if (revision > this.newest) {
      this.newest = revision;
      this.following = this.sceneChanged();
    }
    return this.following;
  }

  async sceneChanged() {
    this.scene = Object.assign(this.scene, await this.server.get('scene.json'));
    this.showState();
    if (this.splats && this.scene.splats && this.scene.training) await this.splats.load(await this.download(this.scene.splats));
    this.changed(false);
    await this.actors?.refresh();
  }

  hear(news) {
    if (news.training) { this.scene.training = news.training; this.showStatus(); }
    if (news.revision !== undefined) this.follow(news.revision)?.catch((error) => this.failed(error));
    if (news.end) this.ended(news.end);
  }

  // What is seen.

  moved() { this.showCamera(); this.changed(); }

  changed(moves = true) {
    this.view.changed(moves);
    this.drawOver();
    clearTimeout(this.addressTimer);
    this.addressTimer = setTimeout(() => this.writeAddress(), 200);
  }

  shown(picture) {
    this.picture = picture;
    document.body.dataset.scale = picture.scale; // for tests
    this.showStatus();
  }

  showState() {
    element('undo').disabled = !this.scene.can_undo;
    element('save').disabled = !this.scene.can_save;
    this.showCamera();
    this.showStatus();
  }

  showCamera() {
    const { recorded } = this.camera;
    if (recorded !== null) this.lastRecorded = recorded;
    element('cameras').value = recorded ?? '';
    element('photo-row').hidden = recorded === null || !this.scene.cameras[recorded].photo || Boolean(this.stored);
  }

  showStatus() {
    const parts = [], { training } = this.scene;
    if (training) {
      parts.push(`step ${training.step}${training.steps ? ` of ${training.steps}` : ''}`);
      if (Number.isFinite(training.loss)) parts.push(`loss ${training.loss.toPrecision(3)}`);
      if (Number.isFinite(training.psnr)) parts.push(`${training.psnr.toFixed(1)} dB`);
    }
    if (this.splats) parts.push(`${this.splats.count().toLocaleString('en')} Gaussians`);
    if (this.picture) {
      if (this.picture.scale > 1) parts.push(`1/${this.picture.scale} of the size`);
      if (Number.isFinite(this.picture.milliseconds)) parts.push(`${Math.round(this.picture.milliseconds)} ms`);
    }
    element('status').textContent = parts.join(' · ');
  }

  drawOver() {
    const canvas = element('overlay'), [width, height] = this.size(), dense = devicePixelRatio;
    const [columns, rows] = [Math.round(width * dense), Math.round(height * dense)];
    if (canvas.width !== columns || canvas.height !== rows) Object.assign(canvas, { width: columns, height: rows });
    const lidar = element('lidar').checked, boxes = element('boxes').checked;
    canvas.hidden = !lidar && !boxes && !this.actors?.picked; // a layer costs time where there is no GPU
    this.placePhoto();
    if (canvas.hidden) return;
    const context = canvas.getContext('2d'), view = this.seen();
    context.setTransform(dense, 0, 0, dense, 0, 0);
    context.clearRect(0, 0, width, height);
    if (lidar) this.drawLidar(context, view);
    this.actors?.draw(context, view, boxes);
  }

  drawLidar(context, view) {
    if (this.points) drawPoints(context, view, this.points, this.camera.up);
    if (this.pointsAt === this.time || this.loadingPoints) return;
    this.loadingPoints = true;
    const time = this.time;
    this.server.ask(`lidar?time=${time}`).then((answer) => answer.arrayBuffer()).then((buffer) => {
      [this.points, this.pointsAt] = [new Float32Array(buffer), time];
    }).catch((error) => { this.pointsAt = time; element('lidar').checked = false; this.failed(error); })
      .finally(() => { this.loadingPoints = false; this.drawOver(); });
  }

  placePhoto() {
    const image = element('photo'), opacity = Number(element('opacity').value) / 100, { recorded } = this.camera;
    image.hidden = recorded === null || opacity === 0 || element('photo-row').hidden;
    if (image.hidden) return;
    const camera = this.scene.cameras[recorded], { scale, left, top } = this.camera.recordedPlace(...this.size());
    if (image.dataset.path !== camera.photo) {
      image.dataset.path = camera.photo;
      image.src = camera.photo;
      image.onerror = () => this.server.ask(camera.photo).catch((error) => this.failed(error));
    }
    Object.assign(image.style, { opacity, left: `${left}px`, top: `${top}px`, width: `${scale * camera.width}px`, height: `${scale * camera.height}px` });
  }

  // The address keeps the view.

  writeAddress() {
    const time = this.scene.times ? `&time=${this.time}` : '';
    history.replaceState(null, '', `#${this.camera.toWords()}${time}`);
  }

  readAddress() {
    const words = new URLSearchParams(location.hash.slice(1));
    const time = words.has('time') ? Number(words.get('time')) : NaN;
    if (this.scene.times && time >= this.scene.times[0] && time <= this.scene.times[1]) {
      this.time = time;
      if (this.play) this.setTime(time);
    }
    return this.camera.fromWords(words);
  }

  // Words to the user.

  say(words, { error = false, id = null } = {}) {
    if (id && document.querySelector(`[data-message="${id}"]`)) return null;
    if (error) for (const old of document.querySelectorAll('.message.error:not([data-message])')) old.remove();
    const box = document.createElement('div'), text = document.createElement('span'), close = document.createElement('button');
    box.className = error ? 'message error' : 'message';
    if (id) box.dataset.message = id;
    text.textContent = words;
    close.textContent = '✕';
    close.setAttribute('aria-label', 'Close this message');
    close.onclick = () => box.remove();
    box.append(text, close);
    element('messages').append(box);
    if (!error && !id) setTimeout(() => box.remove(), 8000);
    return box;
  }

  /** Until the function that it gives is called. */
  busy(words) {
    const box = this.say(words, { id: `busy ${words}` });
    return () => box?.remove();
  }

  failed(error) {
    if (error instanceof Ended) return; // ended() has said so
    this.say(error.message, { error: true });
  }

  ended(why = 'the program has ended') {
    if (this.playing) this.play();
    const command = this.scene.command ?? `cloam view ${this.scene.title}`;
    this.say(`${why[0].toUpperCase()}${why.slice(1)}. To see this again:\n  ${command}\nand open the address that it prints.`, { error: true, id: 'end' });
  }
}

/** Names without the folders that all of them are in. */
function withoutCommon(names) {
  let common = names[0].slice(0, names[0].lastIndexOf('/') + 1);
  while (common && !names.every((name) => name.startsWith(common))) common = common.slice(0, common.slice(0, -1).lastIndexOf('/') + 1);
  return names.map((name) => name.slice(common.length));
}

async function begin() {
  const stored = storedPage();
  try {
    const page = new Page(stored ? stored.scene : await new Server().get('scene.json'), stored);
    globalThis.cloamPage = page; // for tests
    await page.start();
  } catch (error) {
    Page.prototype.say.call(null, error.message, { error: true, id: 'begin' });
    console.error(error);
  }
}

begin();
