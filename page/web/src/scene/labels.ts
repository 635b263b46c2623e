// Labels in the scene: one instanced mesh, and one texture into which a text is drawn when it is new.
//
// Elements of HTML would cost the browser a layout per label and frame.

import {
  BufferAttribute,
  CanvasTexture,
  DynamicDrawUsage,
  InstancedBufferAttribute,
  InstancedBufferGeometry,
  LinearFilter,
  Mesh,
  ShaderMaterial,
  Vector2,
} from "three";

const COLUMNS = 8;
const ROWS = 32;
/** Texts that there is room for; of more, those that have not been asked for the longest make room. */
const CELLS = COLUMNS * ROWS;
const CELL_WIDTH_PX = 256;
const CELL_HEIGHT_PX = 32;
const FONT = "600 20px system-ui, sans-serif";
const MOST_LABELS = 384;
/** How far above its place a label stands, CSS pixels: seen from above, it would hide the head. */
const ABOVE_PX = 14;
/** By so much a label is nearer than its place, metres, as a number of GLSL. */
const NEARER_M = "0.4";
/** Texts are drawn larger than they are shown, so that they are sharp; on narrow canvases they are smaller. */
const SCALE = 0.6;
const NARROW_SCALE = 0.46;
const NARROW_PX = 500;
/** How near to the edges of the canvas a label may come, CSS pixels. */
const MARGIN_PX = 4;

const VERTEX = /* glsl */ `
  attribute vec4 place;   // xyz in the world, cell
  attribute vec2 shape;   // width in pixels of the texture, opacity
  uniform vec2 canvas;    // half the size of the canvas, pixels
  uniform float scale;
  uniform float ratio;    // device pixels per CSS pixel
  uniform float top;      // device pixels at the top of the canvas that something else covers
  varying vec2 vUv;
  varying float vOpacity;
  void main() {
    vec4 inView = viewMatrix * vec4(place.xyz, 1.0);
    // A little nearer, so that nobody's own head or shoulder covers the name.
    inView.z += ${NEARER_M};
    vec4 centre = projectionMatrix * inView;
    vec2 reach = vec2(shape.x, ${CELL_HEIGHT_PX}.0) * scale / 2.0;
    // In pixels from the middle of the canvas.
    vec2 at = centre.xy / centre.w * canvas + vec2(0.0, ${ABOVE_PX}.0 * ratio);
    // A label that the edge would cut off is moved in; one that would not be seen at all stays away.
    if (centre.w > 0.0 && all(lessThan(abs(at), canvas + reach))) {
      vec2 most = canvas - reach - ${MARGIN_PX}.0 * ratio;
      at = clamp(at, -most, vec2(most.x, most.y - top));
    }
    // Whole pixels keep the letters sharp.
    at = floor(at + 0.5);
    gl_Position = vec4((at + position.xy * reach) / canvas * centre.w, centre.zw);
    vec2 cell = vec2(mod(place.w, ${COLUMNS}.0), floor(place.w / ${COLUMNS}.0));
    vec2 uvInCell = vec2((position.x + 1.0) * 0.5 * shape.x / ${CELL_WIDTH_PX}.0, (1.0 - position.y) * 0.5);
    vUv = (cell + uvInCell) / vec2(${COLUMNS}.0, ${ROWS}.0);
    vOpacity = shape.y;
  }
`;

const FRAGMENT = /* glsl */ `
  uniform sampler2D texts;
  varying vec2 vUv;
  varying float vOpacity;
  void main() {
    vec4 texel = texture2D(texts, vUv);
    if (texel.a < 0.02) discard;
    gl_FragColor = vec4(texel.rgb, texel.a * vOpacity);
  }
`;

interface Cell {
  index: number;
  width_px: number;
  used: number;
}

export class Labels {
  readonly mesh: Mesh;
  private readonly canvas = document.createElement("canvas");
  private readonly pen: CanvasRenderingContext2D | null;
  private readonly texture: CanvasTexture;
  private readonly material: ShaderMaterial;
  private readonly place: InstancedBufferAttribute;
  private readonly shape: InstancedBufferAttribute;
  private readonly geometry = new InstancedBufferGeometry();
  private readonly cells = new Map<string, Cell>();
  private count = 0;
  private frame = 0;
  private text = "#ffffff";
  private ground = "#000000";

  constructor() {
    this.canvas.width = COLUMNS * CELL_WIDTH_PX;
    this.canvas.height = ROWS * CELL_HEIGHT_PX;
    this.pen = this.canvas.getContext("2d");
    this.texture = new CanvasTexture(this.canvas);
    this.texture.flipY = false;
    this.texture.generateMipmaps = false;
    this.texture.minFilter = LinearFilter;
    this.texture.premultiplyAlpha = false;
    this.place = new InstancedBufferAttribute(new Float32Array(4 * MOST_LABELS), 4);
    this.shape = new InstancedBufferAttribute(new Float32Array(2 * MOST_LABELS), 2);
    for (const attribute of [this.place, this.shape]) attribute.setUsage(DynamicDrawUsage);
    const corners = new Float32Array([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0]);
    this.geometry.setAttribute("position", new BufferAttribute(corners, 3));
    this.geometry.setIndex([0, 1, 2, 0, 2, 3]);
    this.geometry.setAttribute("place", this.place);
    this.geometry.setAttribute("shape", this.shape);
    this.material = new ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: { texts: { value: this.texture }, canvas: { value: new Vector2(1, 1) }, scale: { value: SCALE }, ratio: { value: 1 }, top: { value: 0 } },
      // Depth is kept, so that nearer labels cover farther ones in whatever order they are drawn.
      transparent: true,
    });
    this.mesh = new Mesh(this.geometry, this.material);
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = 10;
  }

  /** Size of the canvas in device pixels, and device pixels per CSS pixel. */
  resize(width_px: number, height_px: number, ratio: number): void {
    (this.material.uniforms["canvas"]?.value as Vector2).set(width_px / 2, height_px / 2);
    const { scale, ratio: perPixel } = this.material.uniforms;
    if (scale !== undefined) scale.value = (width_px / ratio < NARROW_PX ? NARROW_SCALE : SCALE) * ratio;
    if (perPixel !== undefined) perPixel.value = ratio;
  }

  /** What covers the top of the canvas is so high, device pixels. */
  setTop(top_px: number): void {
    const { top } = this.material.uniforms;
    if (top !== undefined) top.value = top_px;
  }

  setTheme(text: string, ground: string): void {
    this.text = text;
    this.ground = ground;
    this.cells.clear();
    this.pen?.clearRect(0, 0, this.canvas.width, this.canvas.height);
  }

  begin(): void {
    this.count = 0;
    this.frame++;
  }

  /** `colour` is that of the bar at the label's left, CSS; empty for none. */
  add(text: string, colour: string, x: number, y: number, z: number, opacity = 1): void {
    if (this.count >= MOST_LABELS) return;
    const cell = this.cells.get(text) ?? this.draw(text, colour);
    cell.used = this.frame;
    const i = this.count++;
    this.place.array[4 * i] = x;
    this.place.array[4 * i + 1] = y;
    this.place.array[4 * i + 2] = z;
    this.place.array[4 * i + 3] = cell.index;
    this.shape.array[2 * i] = cell.width_px;
    this.shape.array[2 * i + 1] = opacity;
  }

  end(): void {
    this.geometry.instanceCount = this.count;
    this.place.clearUpdateRanges();
    this.place.addUpdateRange(0, 4 * this.count);
    this.place.needsUpdate = true;
    this.shape.clearUpdateRanges();
    this.shape.addUpdateRange(0, 2 * this.count);
    this.shape.needsUpdate = true;
  }

  private draw(text: string, colour: string): Cell {
    const cell = { index: this.freeCell(), width_px: CELL_WIDTH_PX, used: this.frame };
    this.cells.set(text, cell);
    const pen = this.pen;
    if (pen === null) return cell;
    const x = (cell.index % COLUMNS) * CELL_WIDTH_PX;
    const y = Math.floor(cell.index / COLUMNS) * CELL_HEIGHT_PX;
    pen.clearRect(x, y, CELL_WIDTH_PX, CELL_HEIGHT_PX);
    pen.font = FONT;
    const bar_px = colour === "" ? 0 : 8;
    const padding_px = colour === "" ? 2 : 9;
    cell.width_px = Math.min(CELL_WIDTH_PX - 2, Math.ceil(pen.measureText(text).width) + bar_px + 2 * padding_px);
    if (colour !== "") {
      pen.fillStyle = this.ground;
      pen.globalAlpha = 0.82;
      pen.fillRect(x, y + 2, cell.width_px, CELL_HEIGHT_PX - 4);
      pen.globalAlpha = 1;
      pen.fillStyle = colour;
      pen.fillRect(x, y + 2, bar_px, CELL_HEIGHT_PX - 4);
    }
    pen.fillStyle = this.text;
    pen.textBaseline = "middle";
    pen.fillText(text, x + bar_px + padding_px, y + CELL_HEIGHT_PX / 2 + 1, cell.width_px - bar_px - 2 * padding_px);
    this.texture.needsUpdate = true;
    return cell;
  }

  private freeCell(): number {
    if (this.cells.size < CELLS) return this.cells.size;
    let oldest: [string, Cell] | undefined;
    for (const entry of this.cells) if (oldest === undefined || entry[1].used < oldest[1].used) oldest = entry;
    if (oldest === undefined) return 0;
    this.cells.delete(oldest[0]);
    return oldest[1].index;
  }
}
