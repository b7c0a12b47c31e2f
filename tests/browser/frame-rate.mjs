// How fast the viewer's page draws a file of Gaussians in Chromium's software rendering, at 640x360, as the mouse turns it:
//   node tests/browser/frame-rate.mjs FILE [FRAMES]
// Each frame is waited for. "processor" is what Chromium's drawing process used, which other programs do not change much.
import { readdirSync, readFileSync } from 'node:fs';
import { Chromium } from './chromium.mjs';
import { Viewer } from './viewer.mjs';

const [file, frames = 20] = process.argv.slice(2);

function processorSeconds(browser) {
  let ticks = 0;
  for (const id of readdirSync('/proc').filter((name) => /^\d+$/.test(name))) {
    try {
      const words = readFileSync(`/proc/${id}/cmdline`, 'latin1');
      if (!words.includes(browser.profile) || !words.includes('--type=gpu-process')) continue;
      const fields = readFileSync(`/proc/${id}/stat`, 'latin1').split(') ')[1].split(' ');
      ticks += Number(fields[11]) + Number(fields[12]);
    } catch { /* ended meanwhile */ }
  }
  return ticks / 100;
}

const browser = await Chromium.start(), viewer = await Viewer.start(file);
try {
  const page = await browser.page(640, 360);
  await page.open(viewer.address);
  await page.until('window.cloamPage?.view?.finished && document.body.dataset.scale == 1', 120);
  // While the mouse moves, half the size is drawn where the whole takes too long; `slow` off: always the whole.
  for (const whole of [true, false]) {
    const before = processorSeconds(browser);
    const seconds = await page.evaluate(`(async () => {
      const draw = cloamPage.splats.draw, begin = performance.now();
      let drawn = 0;
      cloamPage.splats.draw = (view, moving) => { ++drawn; return draw(view, moving && !${whole}); };
      while (drawn < ${frames}) {
        cloamPage.camera.orbit(0.02, 0);
        cloamPage.moved();
        await new Promise(requestAnimationFrame);
      }
      cloamPage.splats.draw = draw;
      return (performance.now() - begin) / 1000;
    })()`);
    const used = (processorSeconds(browser) - before) / frames;
    console.log(`${await page.evaluate('cloamPage.splats.count()')} Gaussians, ${whole ? 'whole size' : 'as while the mouse moves'}: ` +
      `${(frames / seconds).toFixed(1)} frames a second, ${Math.round(1000 * used)} ms of processor time a frame`);
  }
} finally {
  await viewer.stop();
  await browser.stop();
}
