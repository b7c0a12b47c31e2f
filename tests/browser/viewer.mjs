// The real program: `cloam` with any words, and `cloam view` with the address that it prints.
import { spawn, spawnSync } from 'node:child_process';

export const kProgram = process.env.CLOAM_BINARY || 'build/release/bin/cloam';

export function cloam(...words) {
  const { status, stdout, stderr } = spawnSync(kProgram, words, { encoding: 'utf8', maxBuffer: 1 << 28 });
  if (status !== 0) throw new Error(`cloam ${words.join(' ')}: exit code ${status}\n${stderr}`);
  return stdout;
}

export class Viewer {
  static async start(...words) {
    const viewer = new Viewer();
    viewer.process = spawn(kProgram, ['view', ...words, '--no-open'], { stdio: ['ignore', 'pipe', 'pipe'] });
    viewer.words = '';
    viewer.process.stderr.on('data', (data) => { viewer.words += data; });
    viewer.ended = new Promise((resolve) => viewer.process.once('exit', resolve));
    viewer.address = await new Promise((resolve, reject) => {
      let printed = '';
      viewer.process.stdout.on('data', (data) => {
        printed += data;
        const found = printed.match(/http:\/\/127\.0\.0\.1:\d+\/\w+\//);
        if (found) resolve(found[0]);
      });
      viewer.ended.then((code) => reject(new Error(`cloam view ended with ${code}: ${viewer.words}`)));
    });
    return viewer;
  }

  async get(path) { return (await fetch(this.address + path)).json(); }

  /** As Ctrl-C does. */
  async stop() {
    this.process.kill('SIGINT');
    return this.ended;
  }
}
