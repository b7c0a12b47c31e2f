// The viewer's page in Debian's Chromium, against the real program and small runs: script/browser-test.
import { existsSync, mkdtempSync, readFileSync, readdirSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { pathToFileURL } from 'node:url';
import { Chromium } from './chromium.mjs';
import { cloam, Viewer } from './viewer.mjs';

const only = process.argv[2] ?? ''; // a part of the names of the cases to run
const kSeen = 'document.body.dataset.scale'; // of a first picture
const kReady = 'window.cloamPage?.view?.finished && document.body.dataset.scale == 1';
const scratch = mkdtempSync(join(tmpdir(), 'cloam-browser-'));
const street = join(scratch, 'street_run'), splats = join(scratch, 'splat_run');

function check(holds, words) {
  if (!holds) throw new Error(words);
}

// What is looked at.

function makeRuns() {
  cloam('synth', '-o', join(scratch, 'logs'), '--logs', '1', '--frames', '3', '--size', '96x54', '--cameras', 'front', '--beams', '24', '-q');
  const log = join(scratch, 'logs', '001');
  const settings = (...all) => all.flatMap((setting) => ['--set', setting]);
  cloam('train', 'genassets', log, '-o', street, '--preset', 'genassets-small', '--steps', '8', '-q',
    ...settings('background.side=32', 'batch.patches=1', 'batch.patch_side=8', 'batch.lidar_rays=32', 'code.side=4', 'weight.perceptual=0'));
  cloam('train', 'splat', log, '-o', splats, '--steps', '60', '-q',
    ...settings('initial=random', 'initial.random=3000', 'growth.start=1', 'growth.every=20', 'sh.every=10'));
}

/** Pictures of `render`, as data addresses in the order of the frames. */
function rendered(run, width, height) {
  const folder = mkdtempSync(join(scratch, 'rendered-'));
  cloam('render', run, '-o', folder, '--split', 'all', '--size', `${width}x${height}`, '-q');
  return readdirSync(folder).filter((name) => name.endsWith('.png')).sort()
    .map((name) => 'data:image/png;base64,' + readFileSync(join(folder, name)).toString('base64'));
}

/** PSNR between two pictures in a page: data addresses, or null for what the page shows. */
function likeness(page, a, b) {
  return page.evaluate(`(async () => {
    const pixels = async (from) => {
      let image = document.getElementById('picture');
      if (from) { image = new Image(); image.src = from; await image.decode(); }
      const canvas = document.createElement('canvas');
      Object.assign(canvas, { width: image.width, height: image.height });
      canvas.getContext('2d').drawImage(image, 0, 0);
      return canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
    };
    const [p, q] = [await pixels(${JSON.stringify(a)}), await pixels(${JSON.stringify(b)})];
    if (p.length !== q.length) throw new Error('pictures of ' + p.length + ' and ' + q.length + ' numbers');
    let sum = 0;
    for (let i = 0; i < p.length; ++i) sum += (p[i] - q[i]) ** 2;
    return sum === 0 ? 99 : 10 * Math.log10(255 ** 2 * p.length * 0.75 / sum); // alpha is the same everywhere
  })()`);
}

const picture = (page) => page.evaluate(`document.getElementById('picture').toDataURL()`);
const hash = (page) => page.evaluate('location.hash');
const messages = (page) => page.evaluate(`document.getElementById('messages').innerText`);
const actor = (page) => page.evaluate('cloamPage.actors.actor');
const settled = (milliseconds) => new Promise((resolve) => setTimeout(resolve, milliseconds));

/** The largest actor that is seen at the middle of its box, left of the panel: {id, x, y}; or null. */
const visibleActor = (page) => page.evaluate(`(async () => {
  const view = cloamPage.seen(), inverse = view.world_from_camera;
  const seen = cloamPage.actors.list.filter((a) => a.box && !a.hidden).map((a) => {
    const d = a.box.centre.map((value, k) => value - inverse[4 * k + 3]);
    const [x, y, z] = [0, 1, 2].map((k) => d[0] * inverse[k] + d[1] * inverse[4 + k] + d[2] * inverse[8 + k]);
    return { id: a.id, x: view.fx * x / z + view.cx, y: view.fy * y / z + view.cy, z, size: view.fx * Math.min(...a.box.size) / z };
  }).filter((a) => a.z > 2 && a.x > 60 && a.x < innerWidth - 350 && a.y > 60 && a.y < innerHeight - 60 && a.size > 6);
  seen.sort((a, b) => b.size - a.size);
  for (const actor of seen) {
    const { id } = await cloamPage.server.command('pick', { ...view, x: actor.x, y: actor.y, time: cloamPage.time });
    if (id === actor.id) return actor;
  }
  return null;
})()`);

/** Yellow in the overlay: the outline of the picked actor. */
const outline = (page) => page.evaluate(`(() => {
  const canvas = document.getElementById('overlay');
  const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
  let count = 0;
  for (let i = 0; i < data.length; i += 4) count += data[i] > 200 && data[i + 1] > 170 && data[i + 2] < 120 && data[i + 3] > 200;
  return count;
})()`);

// The cases: each gets a browser; pages that it opens are closed, and looked through, afterwards.

const kAny = { coarse: true }; // a first picture is enough
const viewers = {};
const cases = [];
const test = (name, run) => cases.push({ name, run });

/** A page of the viewer of a run, without edits. Each run has one viewer. */
async function opened(browser, run, width, height, options) {
  const viewer = await (viewers[run] ??= Viewer.start(run));
  while ((await viewer.get('scene.json')).can_undo) await fetch(viewer.address + 'undo', { method: 'POST', body: '{}' });
  return { viewer, page: await browser.show(viewer.address, width, height, options) };
}

test('Gaussians look as render makes them', async (browser) => {
  const truth = rendered(splats, 480, 270);
  const { page } = await opened(browser, splats, 480, 270);
  for (const index of [0, 2]) {
    await page.evaluate(`cloamPage.jump(${index})`);
    await settled(300);
    await page.until(kReady);
    const decibel = await likeness(page, null, truth[index]);
    check(decibel > 38, `camera ${index}: ${decibel} dB`);
  }
  const other = await likeness(page, null, truth[0]);
  check(other < 38, `camera 2 looks like camera 0: ${other} dB`);
});

test('a browser without WebGL 2 shows Gaussians, too: the program draws them', async (browser) => {
  const viewer = await Viewer.start(splats), page = await browser.page(320, 180);
  viewers.again = viewer;
  await page.send('Page.addScriptToEvaluateOnNewDocument', { source: `{
    const real = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...more) { return kind.startsWith('webgl') ? null : real.call(this, kind, ...more); };
  }` });
  await page.open(viewer.address);
  await page.until(kReady, 60);
  const decibel = await likeness(page, null, rendered(splats, 320, 180)[0]); // JPEG
  check(decibel > 33, `${decibel} dB`);
  check((await messages(page)).includes('the program draws them'), `it says: ${await messages(page)}`);
  page.complaints = page.complaints.filter((words) => !words.includes('WebGL'));
});

test('a street looks as render makes it', async (browser) => {
  const truth = rendered(street, 320, 180);
  const { page } = await opened(browser, street, 320, 180);
  const decibel = await likeness(page, null, truth[0]); // the page's frames are JPEG
  check(decibel > 33, `${decibel} dB`);
  check(await likeness(page, null, truth[2]) < decibel, 'any picture would do');
});

test('a drag turns the camera, and a reload brings the view back', async (browser) => {
  const { page } = await opened(browser, splats, 480, 270);
  const [before, first] = [await picture(page), await hash(page)];
  await page.drag(240, 135, 300, 150);
  await settled(400);
  await page.until(kReady);
  const after = await picture(page);
  check(await hash(page) !== first, 'the address did not change');
  check(await likeness(page, before, after) < 30, 'the picture did not change');
  await page.reload();
  await page.until(kReady, 60);
  await settled(300);
  const decibel = await likeness(page, null, after);
  check(decibel > 45, `after a reload: ${decibel} dB`);
});

test('while the mouse moves, coarse pictures come one at a time; then the whole one', async (browser) => {
  const { page } = await opened(browser, street, 480, 270);
  await page.evaluate(`(() => {
    window.levels = []; window.most = 0; let now = 0;
    const post = cloamPage.server.post.bind(cloamPage.server);
    cloamPage.server.post = async (path, body, signal) => {
      if (path === 'frame') levels.push(body.level);
      most = Math.max(most, ++now);
      try { return await post(path, body, signal); } finally { --now; }
    };
  })()`);
  for (let i = 0; i < 3; ++i) await page.drag(200, 135, 220 + 10 * i, 140);
  await settled(400);
  await page.until(kReady, 60);
  const { levels, most } = await page.evaluate('({ levels, most })');
  check(levels[0] === 0 && levels.at(-1) > 0, `levels ${levels}`);
  check(most === 1, `${most} requests at a time`);
  check(await page.evaluate('cloamPage.picture.scale') === 1, 'the last picture is not whole');
});

test('wheel, keys, double click, fingers and reset move the camera', async (browser) => {
  const { page } = await opened(browser, splats, 480, 270, { mobile: true });
  const distance = () => page.evaluate('cloamPage.camera.distance');
  const place = () => page.evaluate('JSON.stringify(cloamPage.camera.pose)');
  const start = await place(), far = await distance();
  const moves = async (what, act) => {
    const before = await place();
    await act();
    await settled(60);
    check(await place() !== before, `${what} moved nothing`);
  };
  await moves('the wheel', () => page.mouse('mouseWheel', 240, 135, { deltaX: 0, deltaY: -200 }));
  check(await distance() < far, 'the wheel went backwards');
  await moves('w', () => page.key('w'));
  await moves('a double click', async () => {
    await page.click(100, 60);
    for (const type of ['mousePressed', 'mouseReleased']) await page.mouse(type, 100, 60, { clickCount: 2 });
  });
  await moves('one finger', () => page.touch([[[240, 135]], [[260, 140]], [[290, 150]]]));
  const closer = await distance();
  await moves('two fingers', () => page.touch([[[220, 135], [260, 135]], [[200, 135], [280, 135]], [[160, 135], [320, 135]]]));
  check(await distance() < closer, 'spreading two fingers went away');
  await page.key('r');
  await settled(60);
  check(await place() === start, 'R did not reset the view');
  await page.key('?');
  check(await page.evaluate(`document.getElementById('help').open`), 'no help');
});

test('an actor is picked, hidden, moved, turned, exchanged, undone and saved', async (browser) => {
  const { page } = await opened(browser, street, 760, 300);
  const target = await visibleActor(page);
  check(target, 'no actor is in the picture');
  await page.click(target.x, target.y);
  await page.until('cloamPage.actors.picked');
  check(await outline(page) > 20, 'no outline');
  check(await page.evaluate('cloamPage.actors.picked') === target.id, 'another one is picked');

  const edit = async (act, seen = kSeen) => {
    const revision = await page.evaluate('cloamPage.scene.revision');
    await act();
    await page.until(`cloamPage.scene.revision > ${revision}`);
    await page.evaluate('cloamPage.following');
    await page.until(seen, 60);
  };
  const before = await picture(page), centre = (await actor(page)).box.centre;
  await edit(() => page.press('#hide'), kReady);
  check((await actor(page)).hidden, 'not hidden');
  check(await likeness(page, before, null) < 60, 'the picture shows it still');
  await edit(() => page.press('#undo'), kReady);
  const decibel = await likeness(page, before, null);
  check(decibel > 60, `not as before: ${decibel} dB`);

  await page.evaluate(`document.getElementById('x').value = 1.5; document.getElementById('y').value = 0`);
  await edit(() => page.press('#move'));
  check(Math.abs((await actor(page)).box.centre[0] - centre[0] - 1.5) < 0.01, 'not moved by 1.5 m');
  const yaw = (await actor(page)).box.yaw;
  await edit(() => page.press('#turn'));
  check(Math.abs(Math.cos((await actor(page)).box.yaw - yaw)) < 0.01, 'not turned by 90 degrees');

  const size = (await actor(page)).thumbnail;
  await page.evaluate(`(() => { const list = document.getElementById('asset');
    list.selectedIndex = cloamPage.actors.assets.findIndex((asset) => asset.label !== cloamPage.actors.actor.label); })()`);
  await edit(() => page.press('#exchange'));
  check((await actor(page)).thumbnail !== size, 'not exchanged');

  const out = join(scratch, 'saved');
  await page.evaluate(`document.getElementById('name').value = ${JSON.stringify(out)}`);
  await page.press('#save');
  await page.until(`document.getElementById('messages').innerText.includes('Saved')`, 60);
  const list = JSON.parse(cloam('edit', out, '--list', '--json', '-q'));
  check(list.actors.length > 0 && existsSync(join(out, 'run.json')), 'the saved run has no actors');
});

test('the mouse drags the picked actor over the ground', async (browser) => {
  const { page } = await opened(browser, street, 760, 300, kAny);
  const target = await visibleActor(page);
  check(target, 'no actor is in the picture');
  await page.evaluate(`cloamPage.actors.pick(${JSON.stringify(target.id)})`);
  const before = (await actor(page)).box.centre, pose = await page.evaluate('JSON.stringify(cloamPage.camera.pose)');
  await page.press('#grab');
  await page.drag(target.x, target.y + 1, target.x + 25, target.y + 4);
  await page.until(`Math.abs(cloamPage.actors.actor.box.centre[0] - ${before[0]}) + Math.abs(cloamPage.actors.actor.box.centre[1] - ${before[1]}) > 0.1`);
  const { centre } = (await actor(page)).box;
  check(Math.abs(centre[2] - before[2]) < 0.05, `it left the ground by ${centre[2] - before[2]} m`);
  check(await page.evaluate('JSON.stringify(cloamPage.camera.pose)') === pose, 'the camera turned, too');
  const seen = await page.evaluate(`(() => { const view = cloamPage.seen(), p = view.world_from_camera;
    const d = cloamPage.actors.actor.box.centre.map((value, k) => value - p[4 * k + 3]);
    const [x, , z] = [0, 1, 2].map((k) => d[0] * p[k] + d[1] * p[4 + k] + d[2] * p[8 + k]);
    return view.fx * x / z + view.cx; })()`);
  check(Math.abs(seen - target.x - 25) < 3, `it is seen ${seen - target.x} pixels further, not 25`);
});

test('what the program refuses is told in words', async (browser) => {
  const { page } = await opened(browser, street, 760, 300, kAny);
  await page.evaluate(`cloamPage.actors.pick(cloamPage.actors.list[0].id); document.getElementById('degrees').value = 1000`);
  await page.press('#turn');
  await page.until(`document.querySelector('.message.error')`);
  check((await messages(page)).includes('1000'), `it says: ${await messages(page)}`);
  page.complaints = page.complaints.filter((words) => !words.includes('status of 400'));
});

test('time, LiDAR and photos', async (browser) => {
  const { page } = await opened(browser, street, 760, 300, kAny);
  const colours = () => page.evaluate(`(() => { const canvas = document.getElementById('overlay');
    return canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.reduce((sum, value) => sum + (value > 0), 0); })()`);
  check(await colours() === 0, 'something lies over the picture');
  await page.press('#lidar');
  await page.until('cloamPage.points');
  await settled(100);
  check(await colours() > 100, 'no points');
  await page.evaluate(`(() => { const slider = document.getElementById('opacity'); slider.value = 100; slider.dispatchEvent(new Event('input')); })()`);
  await page.until(`document.getElementById('photo').naturalWidth === 96`);
  const before = await page.evaluate('cloamPage.time');
  await page.evaluate(`(() => { const slider = document.getElementById('time'); slider.value = slider.max; slider.dispatchEvent(new Event('input')); })()`);
  check(await page.evaluate('cloamPage.time') > before, 'time stands still');
  check(await page.evaluate('cloamPage.camera.recorded') === 2, 'the camera did not ride along');
});

test('two pages show the same scene', async (browser) => {
  const { page, viewer } = await opened(browser, street, 760, 300, kAny);
  const other = await browser.show(viewer.address, 320, 180, kAny);
  const id = await page.evaluate('cloamPage.actors.list[0].id');
  await page.evaluate(`cloamPage.actors.pick(${JSON.stringify(id)})`);
  await page.press('#hide');
  await other.until(`cloamPage.actors.list[0].hidden`);
  check(await other.evaluate('cloamPage.scene.can_undo'), 'the other page cannot undo it');
  await other.evaluate('cloamPage.actors.undo()');
  await page.until('!cloamPage.actors.list[0].hidden');
});

test('a wrong token shows nothing', async (browser) => {
  const { viewer } = await opened(browser, splats, 480, 270);
  const wrong = viewer.address.replace(/.\/$/, (last) => (last === '0/' ? '1/' : '0/'));
  const page = await browser.page(480, 270);
  await page.open(wrong);
  const words = await page.evaluate('document.body.innerText');
  check(words.includes('token') && !words.includes('View'), `it says: ${words}`);
});

test('the page tells when the program ends, and how to start it', async (browser) => {
  const viewer = await Viewer.start(splats), page = await browser.show(viewer.address, 480, 270);
  check(await viewer.stop() === 0, 'Ctrl-C is a failure');
  await page.until(`document.getElementById('messages').innerText.includes('has ended')`);
  check((await messages(page)).includes('cloam view'), `it says: ${await messages(page)}`);
  await page.drag(240, 135, 300, 150); // Gaussians are here already
  await settled(400);
  page.complaints = page.complaints.filter((words) => !words.includes('ERR_'));
});

test('--html writes one file of Gaussians that works without program and network', async (browser) => {
  const file = join(scratch, 'splats.html');
  cloam('view', splats, '--html', file, '-q');
  const page = await browser.show(pathToFileURL(file).href, 480, 270);
  await settled(300);
  const decibel = await likeness(page, null, rendered(splats, 480, 270)[0]);
  check(decibel > 30, `${decibel} dB`); // .spz rounds
  const before = await hash(page);
  await page.drag(240, 135, 300, 150);
  await settled(400);
  check(await hash(page) !== before, 'it does not turn');
});

test('--html writes the recorded ride of a street', async (browser) => {
  const file = join(scratch, 'street.html');
  cloam('view', street, '--html', file, '-q');
  const page = await browser.show(pathToFileURL(file).href, 480, 270);
  const before = await picture(page);
  await page.evaluate(`(() => { const slider = document.getElementById('time'); slider.value = slider.max; slider.dispatchEvent(new Event('input')); })()`);
  await settled(100);
  check(await likeness(page, before, null) < 40, 'the clock changes nothing');
});

test('all controls have names, and the keyboard reaches them', async (browser) => {
  const { page } = await opened(browser, street, 760, 300, { scheme: 'dark', ...kAny });
  const { nodes } = await page.send('Accessibility.getFullAXTree');
  const kinds = ['button', 'slider', 'spinbutton', 'checkbox', 'textbox', 'combobox'];
  const controls = nodes.filter((node) => !node.ignored && kinds.includes(node.role?.value));
  const nameless = controls.filter((node) => !node.name?.value);
  check(controls.length > 15, `only ${controls.length} controls`);
  check(nameless.length === 0, `without a name: ${nameless.map((node) => node.role.value)}`);
  await page.evaluate(`document.getElementById('reset').focus()`);
  await page.key('Tab', { code: 'Tab', windowsVirtualKeyCode: 9 });
  check(await page.evaluate('document.activeElement.id') === 'help-button', 'Tab leads elsewhere');
});

test('no control reaches out of the panel', async (browser) => {
  const { page } = await opened(browser, street, 1100, 680, kAny);
  const outside = await page.evaluate(`(() => {
    const edge = document.getElementById('panel').getBoundingClientRect().right;
    return [...document.querySelectorAll('#panel button, #panel select, #panel input')]
      .filter((control) => control.getBoundingClientRect().right > edge).map((control) => control.id || control.name);
  })()`);
  check(outside.length === 0, `cut off: ${outside}`);
});

// Running them.

async function begin() {
  const browser = await Chromium.start();
  browser.pages = [];
  const bare = browser.page.bind(browser);
  browser.page = async (...how) => {
    const page = await bare(...how);
    browser.pages.push(page);
    return page;
  };
  browser.show = async (address, width, height, options = {}) => {
    const page = await browser.page(width, height, options);
    await page.open(address);
    await page.until(options.coarse ? kSeen : kReady, 60);
    return page;
  };
  return browser;
}

function lookThrough(pages) {
  for (const page of pages) {
    const away = page.requests.filter((url) => !/^(http:\/\/127\.0\.0\.1:|data:|blob:|file:)/.test(url));
    check(away.length === 0, `it asked ${away[0]}`);
    const complaints = page.complaints.filter((words) => !/status of 40[39]/.test(words)); // dropped frames; the wrong token
    check(complaints.length === 0, `the browser complains: ${complaints.join('\n')}`);
  }
}

/** What the pages of a failed case showed, if there is a folder for it. */
async function keepPictures(name, pages) {
  const folder = process.env.CLOAM_BROWSER_PICTURES;
  for (const [i, page] of folder ? pages.entries() : []) {
    const file = join(folder, `${name.replaceAll(/\W+/g, '-')}-${i}.png`);
    await page.screenshot().then((bytes) => writeFileSync(file, bytes), () => {});
    console.log(`      ${file}: ${await messages(page).catch(() => '')}`);
  }
}

let passed = 0, failed = 0;
let browser = null;
try {
  makeRuns();
  browser = await begin();
} catch (error) {
  console.log(`FAIL  what the tests need could not be made\n${error.stack}`);
  failed = 1;
}
for (const { name, run } of browser ? cases : []) {
  if (!name.includes(only)) continue;
  const start = Date.now();
  try {
    await run(browser);
    lookThrough(browser.pages);
    console.log(`ok    ${name} (${((Date.now() - start) / 1000).toFixed(1)} s)`);
    ++passed;
  } catch (error) {
    console.log(`FAIL  ${name}\n      ${error.stack}`);
    ++failed;
    await keepPictures(name, browser.pages);
  }
  for (const page of browser.pages.splice(0)) await page.close().catch(() => {});
}
for (const viewer of Object.values(viewers)) await (await viewer).stop();
await browser?.stop();
rmSync(scratch, { recursive: true, force: true });
console.log(`${passed} passed, ${failed} failed`);
process.exit(failed ? 1 : 0);
