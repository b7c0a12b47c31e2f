// Gaussians drawn by the browser: three.js and Spark, bundled at build time into one script that gives `cloamSplats`.
//
// Spark sorts, keeps the splats on the GPU and evaluates their colours. How a splat becomes pixels is written here, for two
// reasons: it shall be what `cloam render` draws (kernels/splat_project.cl, kernels/splat.cl), and SwiftShader, with which
// browsers draw where there is no GPU, treats each instance as a draw call of its own: one splat an instance, as Spark has
// it, takes five times as long as many.
import { SparkRenderer, SplatMesh } from '@sparkjsdev/spark';
import * as THREE from 'three';

const kPerInstance = 128;
const kLeastAlpha = 1 / 255;
const kBlur = 0.3; // square pixels, as in runtime/ops/splat.h
const kSlowFrame = 150; // milliseconds
const kMostThinning = 16;

const kVertex = `
precision highp float;
precision highp int;
precision highp usampler2DArray;
#include <splatDefines>
flat out vec4 colour;
out vec2 place;  // in deviations
uniform vec2 renderSize;
uniform vec4 renderToViewQuat;
uniform vec3 renderToViewPos;
uniform float preBlurAmount, blurAmount;
uniform usampler2D ordering;
uniform usampler2DArray extSplats, extSplats2;
uniform int splatCount, thinning;

void main() {
  gl_Position = vec4(0.0, 0.0, 2.0, 1.0);  // seen by nobody
  int rank = (gl_InstanceID * ${kPerInstance} + gl_VertexID / 4) * thinning;
  if (rank >= splatCount) return;
  uint index = texelFetch(ordering, ivec2((rank >> 2) & 4095, rank >> 14), 0)[rank & 3];
  if (index == 0xffffffffu) return;
  ivec3 texel = splatTexCoord(int(index));
  uvec4 first = texelFetch(extSplats, texel, 0);
  if (unpackSplatExtAlpha(first) < ${kLeastAlpha}) return;

  vec3 centre, scales;
  vec4 quaternion, rgba;
  unpackSplatExt(first, texelFetch(extSplats2, texel, 0), centre, scales, quaternion, rgba);
  vec3 t = quatVec(renderToViewQuat, centre) + renderToViewPos;
  vec4 clip = projectionMatrix * vec4(t, 1.0);
  if (t.z >= 0.0 || clip.z < -clip.w) return;

  // The projection's derivative, its slopes held to the picture and 0.3 of its half width around.
  vec2 focal = 0.5 * renderSize * vec2(projectionMatrix[0][0], projectionMatrix[1][1]);
  vec2 middle = vec2(projectionMatrix[2][0], projectionMatrix[2][1]);
  vec2 most = 0.5 * renderSize * 1.3 / focal, shift = 0.5 * renderSize * middle / focal;
  vec2 slope = clamp(t.xy / -t.z, shift - most, shift + most);
  mat3 n = scaleQuaternionToMatrix(scales, quatQuat(renderToViewQuat, quaternion));
  vec3 px = focal.x / -t.z * (vec3(n[0].x, n[1].x, n[2].x) + slope.x * vec3(n[0].z, n[1].z, n[2].z));
  vec3 py = focal.y / -t.z * (vec3(n[0].y, n[1].y, n[2].y) + slope.y * vec3(n[0].z, n[1].z, n[2].z));

  // Where some stand for all, they cover as much.
  px *= sqrt(float(thinning)), py *= sqrt(float(thinning));
  float xx = dot(px, px) + preBlurAmount, yy = dot(py, py) + preBlurAmount, xy = dot(px, py);
  float sharp = xx * yy - xy * xy;
  xx += blurAmount, yy += blurAmount;
  float det = xx * yy - xy * xy;
  float alpha = rgba.a * sqrt(max(0.0, sharp / det));
  if (!(alpha >= ${kLeastAlpha})) return;

  float half_trace = 0.5 * (xx + yy), spread = sqrt(max(0.0, half_trace * half_trace - det));
  vec2 axis = abs(xy) > 1e-4 ? normalize(vec2(xy, half_trace + spread - xx)) : xx >= yy ? vec2(1, 0) : vec2(0, 1);
  float reach = sqrt(2.0 * log(alpha / ${kLeastAlpha}));  // where alpha is 1/255
  place = position.xy * reach;
  vec2 offset = place.x * sqrt(half_trace + spread) * axis +
                place.y * sqrt(max(0.0, half_trace - spread)) * vec2(axis.y, -axis.x);
  colour = vec4(max(rgba.rgb, 0.0), alpha);
  gl_Position = vec4(clip.xy + 2.0 * offset / renderSize * clip.w, 0.0, clip.w);
}`;

const kFragment = `
precision highp float;
flat in vec4 colour;
in vec2 place;
out vec4 result;
void main() {
  float alpha = min(0.99, colour.a * exp(-0.5 * dot(place, place)));
  if (alpha < ${kLeastAlpha}) discard;
  result = vec4(colour.rgb * alpha, alpha);
}`;

/** Quads by the hundred; uniforms: how many splats there are, and of how many each one is drawn. */
function manyAnInstance({ splatCount, thinning }) {
  const corners = new Float32Array(12 * kPerInstance), order = new Uint16Array(6 * kPerInstance);
  for (let i = 0; i < kPerInstance; ++i) {
    corners.set([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0], 12 * i);
    order.set([0, 1, 2, 0, 2, 3].map((corner) => corner + 4 * i), 6 * i);
  }
  const geometry = new THREE.InstancedBufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(corners, 3));
  geometry.setIndex(new THREE.BufferAttribute(order, 1));
  Object.defineProperty(geometry, 'instanceCount', { // Spark writes the number of splats here
    get: () => Math.ceil(splatCount.value / thinning.value / kPerInstance),
    set: (splats) => { splatCount.value = splats; },
  });
  return geometry;
}

/** What a camera of fx, fy, cx, cy in pixels sees, as OpenGL has it. */
function projection({ width, height, fx, fy, cx, cy }, near) {
  return new THREE.Matrix4().set(
    2 * fx / width, 0, 1 - 2 * cx / width, 0,
    0, 2 * fy / height, 2 * cy / height - 1, 0,
    0, 0, -1, -2 * near,
    0, 0, -1, 0);
}

/**
 * Draws the gaussians of a file into a canvas. Throws where there is no WebGL 2.
 * options: name (its extension is the format), background, antialiased (Mip-Splatting), near,
 * world_from_splats (12 numbers or nothing), changed() (called when a better picture can be drawn).
 */
export async function createSplats(canvas, bytes, options) {
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: false, depth: false, stencil: false,
    preserveDrawingBuffer: true });
  renderer.setClearColor(new THREE.Color(options.background ?? '#000000'), 1);
  const scene = new THREE.Scene();
  const spark = new SparkRenderer({ renderer, onDirty: options.changed, vertexShader: kVertex, fragmentShader: kFragment,
    extraUniforms: { splatCount: { value: 0 }, thinning: { value: 1 } }, depthTest: false, accumExtSplats: true, sortRadial: false,
    minAlpha: kLeastAlpha, preBlurAmount: options.antialiased ? 0 : kBlur, blurAmount: options.antialiased ? kBlur : 0 });
  spark.geometry = manyAnInstance(spark.uniforms);
  scene.add(spark);

  const camera = new THREE.PerspectiveCamera();
  camera.matrixAutoUpdate = false;
  let mesh = null;
  async function load(content) {
    const next = new SplatMesh({ fileBytes: content, fileName: options.name, extSplats: true, raycastable: false });
    await next.initialized;
    if (mesh) { scene.remove(mesh); mesh.dispose(); }
    mesh = next;
    const rows = options.world_from_splats ?? [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];
    mesh.matrixAutoUpdate = false;
    mesh.matrix.set(...rows, 0, 0, 0, 1);
    mesh.matrix.decompose(mesh.position, mesh.quaternion, mesh.scale);
    scene.add(mesh);
  }
  await load(bytes);

  let whole = 0; // milliseconds that all of it takes
  return {
    load,
    count: () => mesh.numSplats,
    /**
     * Draws at once; moving: at half the size where the whole takes too long, and where it takes far too long, some of
     * the Gaussians for all. Gives scale and milliseconds.
     */
    draw(view, moving) {
      const begin = performance.now(), scale = moving && whole > kSlowFrame ? 2 : 1;
      spark.uniforms.thinning.value = scale === 1 ? 1 : Math.min(kMostThinning, Math.max(1, Math.round(whole / (2 * kSlowFrame))));
      const width = Math.ceil(view.width / scale), height = Math.ceil(view.height / scale);
      if (canvas.width !== width || canvas.height !== height) renderer.setSize(width, height, false);
      const p = view.world_from_camera;
      camera.matrix.set(p[0], -p[1], -p[2], p[3], p[4], -p[5], -p[6], p[7], p[8], -p[9], -p[10], p[11], 0, 0, 0, 1);
      camera.matrix.decompose(camera.position, camera.quaternion, camera.scale);
      camera.near = options.near;
      camera.projectionMatrix.copy(projection(view, camera.near));
      camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
      camera.updateMatrixWorld(true);
      renderer.render(scene, camera);
      renderer.getContext().readPixels(0, 0, 1, 1, WebGL2RenderingContext.RGBA, WebGL2RenderingContext.UNSIGNED_BYTE,
        new Uint8Array(4)); // waits until it is drawn: else frames pile up where drawing is slow
      const milliseconds = performance.now() - begin;
      if (scale === 1 && spark.activeSplats > 0) whole = milliseconds;
      return { scale, milliseconds };
    },
    sorted: () => !spark.sorting && spark.activeSplats > 0,
  };
}
