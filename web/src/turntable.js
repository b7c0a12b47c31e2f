// Pictures from all sides that a page without a program holds: what the mouse turns to is the nearest of them.
import { column, dot } from './vectors.js';

export class Turntable {
  /** scene.turntable: [{world_from_camera, picture: "data:..."}]. */
  constructor(canvas, scene, { camera, shown }) {
    Object.assign(this, { canvas, camera, shown, finished: true });
    this.pictures = scene.turntable.map((view) => {
      const image = new Image();
      image.src = view.picture;
      image.onload = () => this.changed();
      return { image, forward: column(view.world_from_camera, 2) };
    });
  }

  changed() {
    const forward = column(this.camera().pose, 2);
    const nearest = this.pictures.reduce((best, next) => (dot(next.forward, forward) > dot(best.forward, forward) ? next : best));
    if (!nearest.image.complete || !nearest.image.naturalWidth) return;
    const { clientWidth: width, clientHeight: height } = this.canvas, { image } = nearest;
    Object.assign(this.canvas, { width, height });
    const scale = Math.min(width / image.naturalWidth, height / image.naturalHeight);
    const [w, h] = [scale * image.naturalWidth, scale * image.naturalHeight];
    this.canvas.getContext('2d').drawImage(image, (width - w) / 2, (height - h) / 2, w, h);
    this.shown({ scale: 1, level: 2 });
  }
}
