// The program behind the page. Everything it says goes through here; addresses are relative to the page's own, which
// holds the token. A page that was written as a file has its data inside instead.

export class Ended extends Error {}

export class Server {
  constructor() { this.onEnd = () => {}; }

  async ask(path, options = {}) {
    let answer;
    try {
      answer = await fetch(path, options);
    } catch (error) {
      if (error.name === 'AbortError') throw error;
      this.onEnd();
      throw new Ended('the program has ended');
    }
    if (answer.ok) return answer;
    const text = await answer.text();
    let why = text;
    try { why = JSON.parse(text).error ?? text; } catch { /* not JSON: the text itself */ }
    const error = new Error(why || `${path}: ${answer.status}`);
    error.status = answer.status;
    throw error;
  }

  async get(path) { return (await this.ask(path)).json(); }

  post(path, body, signal) {
    return this.ask(path, { method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(body), signal });
  }

  async command(path, body = {}) { return (await this.post(path, body)).json(); }

  /** Calls news(object) for each message; ends by itself when the program does. */
  listen(news) {
    const events = new EventSource('events');
    const take = (message) => {
      try { news(JSON.parse(message.data)); } catch { /* a line cut short */ }
    };
    for (const kind of ['message', 'revision', 'training', 'end']) events.addEventListener(kind, take);
    events.onerror = () => {
      // The browser tries again by itself; whether anyone is there, a question of our own tells.
      this.ask('scene.json').catch((error) => { if (error instanceof Ended) events.close(); });
    };
    this.onClose = () => events.close();
  }
}

/** The data of a page that `--html` wrote: {scene, bytes of a named part}; null for a page that a server gave. */
export function storedPage() {
  const scene = document.getElementById('stored-scene');
  if (!scene) return null;
  return {
    scene: JSON.parse(scene.textContent),
    bytes: (name) => {
      const text = atob(document.getElementById(`stored-${name}`).textContent.trim());
      return Uint8Array.from(text, (letter) => letter.charCodeAt(0));
    },
  };
}
