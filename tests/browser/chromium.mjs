// Debian's Chromium, driven over the DevTools protocol through a pipe: node alone, no packages.
import { spawn } from 'node:child_process';
import { mkdtempSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

const kFlags = [
  '--headless=new', '--remote-debugging-pipe', '--no-first-run', '--no-default-browser-check', '--disable-sync',
  '--disable-background-networking', '--disable-component-update', '--disable-default-apps', '--disable-extensions',
  '--disable-dev-shm-usage', '--hide-scrollbars', '--mute-audio', '--force-color-profile=srgb',
  // WebGL2 by the processor alone, so that a test does not depend on a graphics card.
  '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
  '--disable-background-timer-throttling', '--disable-renderer-backgrounding', '--disable-backgrounding-occluded-windows',
];

export class Chromium {
  /** Starts a browser with a profile of its own. */
  static async start(program = process.env.CLOAM_CHROMIUM || 'chromium') {
    const browser = new Chromium();
    browser.profile = mkdtempSync(join(tmpdir(), 'cloam-chromium-'));
    const flags = [...kFlags, `--user-data-dir=${browser.profile}`];
    if (process.getuid?.() === 0) flags.push('--no-sandbox'); // Chromium refuses its sandbox to root
    browser.process = spawn(program, flags, { stdio: ['ignore', 'ignore', 'pipe', 'pipe', 'pipe'] });
    browser.words = '';
    browser.process.stderr.on('data', (data) => { browser.words = (browser.words + data).slice(-4000); });
    browser.waiting = new Map();
    browser.listeners = new Map();
    browser.lastId = 0;
    let rest = Buffer.alloc(0);
    browser.process.stdio[4].on('data', (data) => {
      rest = Buffer.concat([rest, data]);
      for (let end = rest.indexOf(0); end >= 0; end = rest.indexOf(0)) {
        browser.receive(JSON.parse(rest.subarray(0, end).toString()));
        rest = rest.subarray(end + 1);
      }
    });
    browser.process.on('exit', () => {
      for (const { reject } of browser.waiting.values()) reject(new Error(`Chromium ended: ${browser.words}`));
      browser.waiting.clear();
    });
    await browser.send('Target.setDiscoverTargets', { discover: true });
    return browser;
  }

  receive(message) {
    if (message.id) {
      const { resolve, reject, method } = this.waiting.get(message.id) ?? {};
      this.waiting.delete(message.id);
      if (message.error) reject?.(new Error(`${method}: ${message.error.message}`));
      else resolve?.(message.result);
    } else {
      this.listeners.get(message.sessionId)?.(message.method, message.params);
    }
  }

  send(method, params = {}, sessionId = undefined) {
    return new Promise((resolve, reject) => {
      const id = ++this.lastId;
      this.waiting.set(id, { resolve, reject, method });
      this.process.stdio[3].write(JSON.stringify({ id, method, params, sessionId }) + '\0');
    });
  }

  /** A tab of that size in a window of its own: no storage is shared with others. */
  async page(width = 1280, height = 720, options = {}) {
    const { browserContextId } = await this.send('Target.createBrowserContext');
    const { targetId } = await this.send('Target.createTarget', { url: 'about:blank', browserContextId });
    const { sessionId } = await this.send('Target.attachToTarget', { targetId, flatten: true });
    const page = new Page(this, sessionId, targetId);
    this.listeners.set(sessionId, (method, params) => page.receive(method, params));
    for (const domain of ['Page', 'Runtime', 'Network', 'Log']) await page.send(`${domain}.enable`);
    await page.send('Emulation.setDeviceMetricsOverride',
      { width, height, deviceScaleFactor: options.scale ?? 1, mobile: options.mobile ?? false });
    if (options.mobile) await page.send('Emulation.setTouchEmulationEnabled', { enabled: true });
    if (options.scheme)
      await page.send('Emulation.setEmulatedMedia', { features: [{ name: 'prefers-color-scheme', value: options.scheme }] });
    return page;
  }

  async stop() {
    const ended = new Promise((resolve) => this.process.once('exit', resolve));
    if (this.process.exitCode === null) {
      this.send('Browser.close').catch(() => {});
      const late = setTimeout(() => this.process.kill('SIGKILL'), 5000);
      await ended;
      clearTimeout(late);
    }
    rmSync(this.profile, { recursive: true, force: true, maxRetries: 5 });
  }
}

class Page {
  constructor(browser, sessionId, targetId) {
    Object.assign(this, { browser, sessionId, targetId, complaints: [], requests: [] });
  }

  send(method, params) { return this.browser.send(method, params, this.sessionId); }

  receive(method, params) {
    if (method === 'Network.requestWillBeSent') this.requests.push(params.request.url);
    if (method === 'Runtime.exceptionThrown')
      this.complaints.push(params.exceptionDetails.exception?.description ?? params.exceptionDetails.text);
    if (method === 'Runtime.consoleAPICalled' && ['error', 'warning', 'assert'].includes(params.type))
      this.complaints.push(`${params.type}: ${params.args.map((a) => a.value ?? a.description).join(' ')}`);
    if (method === 'Log.entryAdded' && params.entry.level === 'error')
      this.complaints.push(`${params.entry.text} ${params.entry.url ?? ''}`);
    if (method === 'Page.loadEventFired') this.loaded?.();
  }

  async open(url) {
    const loaded = new Promise((resolve) => { this.loaded = resolve; });
    const { errorText } = await this.send('Page.navigate', { url });
    if (errorText) throw new Error(`${url}: ${errorText}`);
    await loaded;
  }

  async reload() {
    const loaded = new Promise((resolve) => { this.loaded = resolve; });
    await this.send('Page.reload');
    await loaded;
  }

  /** The value of an expression, or of the promise that it gives. */
  async evaluate(expression) {
    const { result, exceptionDetails } =
      await this.send('Runtime.evaluate', { expression, awaitPromise: true, returnByValue: true });
    if (exceptionDetails) throw new Error(`${expression}: ${exceptionDetails.exception?.description ?? exceptionDetails.text}`);
    return result.value;
  }

  /** Waits until an expression is true, and gives its value. */
  async until(expression, seconds = 20) {
    const end = Date.now() + 1000 * seconds;
    for (;;) {
      const value = await this.evaluate(expression);
      if (value) return value;
      if (Date.now() > end)
        throw new Error(`not within ${seconds} s: ${expression}\n${this.complaints.join('\n')}`);
      await new Promise((resolve) => setTimeout(resolve, 50));
    }
  }

  async mouse(type, x, y, more = {}) {
    await this.send('Input.dispatchMouseEvent', { type, x, y, button: 'left', clickCount: 1, ...more });
  }

  async click(x, y) {
    await this.mouse('mousePressed', x, y);
    await this.mouse('mouseReleased', x, y);
  }

  /** The middle of what a selector finds is clicked. */
  async press(selector) {
    const { x, y } = await this.evaluate(`(() => { const e = document.querySelector(${JSON.stringify(selector)});
      e.scrollIntoView({block: 'nearest'}); const r = e.getBoundingClientRect();
      return {x: r.x + r.width / 2, y: r.y + r.height / 2}; })()`);
    await this.click(x, y);
  }

  async drag(x0, y0, x1, y1, more = {}) {
    await this.mouse('mousePressed', x0, y0, more);
    for (let i = 1; i <= 8; ++i)
      await this.mouse('mouseMoved', x0 + (x1 - x0) * i / 8, y0 + (y1 - y0) * i / 8, { buttons: 1, ...more });
    await this.mouse('mouseReleased', x1, y1, more);
  }

  /** Fingers: for each moment where they are. */
  async touch(moments) {
    const points = (moment) => moment.map(([x, y], id) => ({ x, y, id }));
    await this.send('Input.dispatchTouchEvent', { type: 'touchStart', touchPoints: points(moments[0]) });
    for (const moment of moments.slice(1))
      await this.send('Input.dispatchTouchEvent', { type: 'touchMove', touchPoints: points(moment) });
    await this.send('Input.dispatchTouchEvent', { type: 'touchEnd', touchPoints: [] });
  }

  async key(key, more = {}) {
    const text = key.length === 1 ? key : undefined;
    await this.send('Input.dispatchKeyEvent', { type: 'keyDown', key, text, ...more });
    await this.send('Input.dispatchKeyEvent', { type: 'keyUp', key, ...more });
  }

  /** A PNG of the window. */
  async screenshot(clip = undefined) {
    const { data } = await this.send('Page.captureScreenshot', { format: 'png', clip: clip && { scale: 1, ...clip } });
    return Buffer.from(data, 'base64');
  }

  async close() { await this.browser.send('Target.closeTarget', { targetId: this.targetId }); }
}
