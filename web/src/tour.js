// Pictures that a page without a program holds: the mouse, or the clock, goes from one to the next.
import { column, dot } from './vectors.js';

export class Tour {
  /** scene.tour: [{world_from_camera, time, picture: "data:..."}]. */
  constructor(canvas, scene, { camera, time, shown }) {
    Object.assign(this, { canvas, scene, camera, time, shown });
    this.pictures = scene.tour.map((view) => {
      const image = new Image();
      image.onload = () => this.changed();
      image.src = view.picture;
      return { image, time: view.time, forward: column(view.world_from_camera, 2) };
    });
  }

  /** Of a street the picture of that time; else the one that looks most the same way. */
  nearest() {
    const forward = column(this.camera().pose, 2), time = this.time();
    const worth = (picture) => (this.scene.times ? -Math.abs(picture.time - time) : dot(picture.forward, forward));
    return this.pictures.reduce((best, next) => (worth(next) > worth(best) ? next : best));
  }

  get finished() { return this.image?.complete ?? false; }

  changed() {
    const { image } = this.nearest(), { clientWidth: width, clientHeight: height } = this.canvas;
    if (!image.complete || !image.naturalWidth) return;
    this.image = image;
    Object.assign(this.canvas, { width, height });
    const scale = Math.min(width / image.naturalWidth, height / image.naturalHeight);
    const [w, h] = [scale * image.naturalWidth, scale * image.naturalHeight];
    this.canvas.getContext('2d').drawImage(image, (width - w) / 2, (height - h) / 2, w, h);
    this.shown({ scale: 1, level: 2 });
  }
}
