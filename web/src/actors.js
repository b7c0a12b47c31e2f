// The list of actors and what is done to the picked one.
import { element } from './element.js';
import { drawBox, extentOf, pixelOf } from './overlay.js';
import { add, column, dot, minus, times } from './vectors.js';

const kFarthest = 300; // scene units: beyond, near the horizon, a pixel is too many metres

export class Actors {
  /** changed(): the overlay must be drawn anew; done(): the scene is another one; camera(), time(), failed(error). */
  constructor(server, scene, actions) {
    Object.assign(this, { server, scene, actions, list: [], assets: [], picked: null, dragged: null });
    const number = (id) => Number(element(id).value);
    const press = (id, action) => element(id).addEventListener('click', action);
    press('hide', () => this.toggle());
    press('go', () => this.goTo());
    press('grab', () => this.grab(!this.grabbing));
    press('move', () => this.edit('move', { shift: [number('x'), number('y'), number('z')] }));
    press('turn', () => this.edit('turn', { degrees: number('degrees') }));
    press('exchange', () => this.edit('exchange', { asset: element('asset').value }));
    press('generate', () => this.edit('generate', { seed: number('seed') }).then((done) => { if (done) ++element('seed').value; }));
    press('undo', () => this.undo());
    element('edit').addEventListener('submit', (event) => event.preventDefault());
    element('saving').addEventListener('submit', (event) => { event.preventDefault(); this.save(); });
  }

  get actor() { return this.list.find((actor) => actor.id === this.picked) ?? null; }
  get grabbing() { return element('grab').getAttribute('aria-pressed') === 'true'; }

  /** Asks for the actors at the time that is shown. While the clock runs, one question at a time. */
  async refresh() {
    if (this.asking) return void (this.again = true);
    this.asking = true;
    try {
      const { actors, assets } = await this.server.get(`actors?time=${this.actions.time()}`);
      [this.list, this.assets] = [actors, assets];
      this.show();
    } catch (error) { this.actions.failed(error); }
    this.asking = false;
    if (this.again) { this.again = false; await this.refresh(); }
  }

  show() {
    const key = JSON.stringify([this.picked, this.list.map((a) => [a.id, a.label, a.name, a.hidden, a.thumbnail, !a.box])]);
    if (key !== this.shownAs) this.fillList();
    this.shownAs = key;
    const actor = this.actor;
    element('edit').hidden = !actor;
    if (actor) {
      element('picked').textContent = words(actor);
      element('hide').textContent = actor.hidden ? 'Show' : 'Hide';
      for (const id of ['grab', 'move', 'turn', 'exchange', 'generate']) element(id).disabled = actor.hidden;
      element('grab').disabled ||= !actor.box;
      element('go').disabled = !actor.box;
    }
    const options = this.assets.map((asset) => new Option(words(asset), asset.id));
    if (element('asset').length !== options.length) element('asset').replaceChildren(...options);
    this.actions.changed();
  }

  fillList() {
    const focused = document.activeElement?.dataset?.id;
    element('actors').replaceChildren(...this.list.map((actor) => {
      const item = document.createElement('li'), button = document.createElement('button');
      button.dataset.id = actor.id;
      button.setAttribute('aria-pressed', String(actor.id === this.picked));
      const image = document.createElement(actor.thumbnail ? 'img' : 'span');
      if (actor.thumbnail) Object.assign(image, { src: actor.thumbnail, alt: '', loading: 'lazy' });
      else image.className = 'blank';
      const text = document.createElement('span'), state = document.createElement('small');
      text.className = 'words';
      state.textContent = actor.hidden ? 'hidden' : actor.box ? actor.name ?? actor.id : 'not here at this time';
      text.append(actor.label, state);
      button.append(image, text);
      if (actor.hidden || !actor.box) button.classList.add('absent');
      button.addEventListener('click', () => this.pick(actor.id === this.picked ? null : actor.id));
      item.append(button);
      return item;
    }));
    if (focused) element('actors').querySelector(`[data-id="${CSS.escape(focused)}"]`)?.focus({ preventScroll: true });
  }

  pick(id) {
    this.picked = id;
    if (!this.actor) this.grab(false);
    this.show();
    element('actors').querySelector('[aria-pressed=true]')?.scrollIntoView({ block: 'nearest' });
  }

  async pickAt(view, x, y) {
    try {
      const { id } = await this.server.command('pick', { ...view, x, y, time: this.actions.time() });
      this.pick(id);
    } catch (error) { this.actions.failed(error); }
  }

  goTo() {
    const box = this.actor?.box, camera = this.actions.camera();
    if (!box) return;
    const ahead = column(camera.pose, 2), size = Math.hypot(...box.size);
    camera.look(minus(add(box.centre, times(camera.up, 0.5 * size)), times(ahead, 2.2 * size)), box.centre);
    this.actions.moved();
  }

  toggle() { if (this.actor) this.edit(this.actor.hidden ? 'show' : 'hide'); }

  grab(on) { element('grab').setAttribute('aria-pressed', String(on)); }

  async edit(op, more = {}) {
    if (!this.actor) return false;
    return this.run(op === 'generate' ? 'Generating …' : '', 'edit', { op, id: this.picked, time: this.actions.time(), ...more });
  }

  undo() { return this.run('', 'undo', {}); }

  async run(word, path, body) {
    const done = word ? this.actions.busy(word) : () => {};
    try {
      const { revision } = await this.server.command(path, body);
      await this.actions.done(revision);
      return true;
    } catch (error) {
      this.actions.failed(error);
      return false;
    } finally {
      done();
    }
  }

  async save() {
    const done = this.actions.busy('Saving …');
    try {
      const { run } = await this.server.command('save', { path: element('name').value.trim() });
      this.actions.said(`Saved as the run ${run}`);
    } catch (error) { this.actions.failed(error); }
    done();
  }

  /** A drag that begins on the picked actor moves it over the ground: gives {move, drop}, or null. */
  drag(x, y, size) {
    const actor = this.actor;
    if (!this.grabbing || !actor?.box || actor.hidden) return null;
    const camera = this.actions.camera(), view = camera.view(...size), extent = extentOf(view, actor.box);
    if (!extent || x < extent.left || x > extent.right || y < extent.top || y > extent.bottom) return null;
    const { centre } = actor.box, [seenX, seenY] = pixelOf(view, centre);
    this.dragged = [0, 0, 0];
    return {
      // The middle of the box stays under the mouse, at its height over the ground.
      move: (px, py) => {
        const { origin, direction } = camera.ray(seenX + px - x, seenY + py - y, ...size);
        const reach = dot(minus(centre, origin), camera.up) / dot(direction, camera.up);
        if (reach > 0 && reach < kFarthest) this.dragged = minus(add(origin, times(direction, reach)), centre);
        this.actions.changed();
      },
      drop: async (far) => {
        const shift = this.dragged;
        if (far) await this.edit('move', { shift });
        this.dragged = null;
        this.actions.changed();
      },
    };
  }

  /** Outlines: the picked actor's, and with `all` everyone's. */
  draw(context, view, all) {
    for (const actor of this.list) {
      const isPicked = actor.id === this.picked;
      if (!actor.box || (!isPicked && (!all || actor.hidden))) continue;
      drawBox(context, view, actor.box, { colour: isPicked ? '#ffd23f' : '#7ee0ff', width: isPicked ? 2 : 1, dashed: actor.hidden });
      if (isPicked && this.dragged) drawBox(context, view, shifted(actor.box, this.dragged), { colour: '#7dff9b', width: 2 });
    }
  }
}

const words = (thing) => [thing.label, thing.name ?? thing.id].filter(Boolean).join(' ');

function shifted(box, by) {
  const pose = box.world_from_box.map((value, i) => (i % 4 === 3 ? value + by[(i - 3) / 4] : value));
  return { ...box, world_from_box: pose };
}
