// People as solid bodies: all limbs of all people are one mesh, and their shadows on the floor another.
//
// A limb is a capsule whose ends, radii and flatness are four texels of a texture; the vertex shader builds it from the
// corners of a unit capsule. So the processor writes 16 numbers a limb and makes no matrix, and nothing is allocated once the
// meshes stand. They are no instances: where the processor draws (no graphics card), each instance costs as much as a mesh.

import { BufferAttribute, BufferGeometry, Color, Mesh, ShaderMaterial, Vector3 } from "three";
import { COASTING, TENTATIVE, type People } from "../protocol/ticks.ts";
import type { Determined } from "../determined.ts";
import { GUESS_COLOUR, mix, personColour, sigmaColour } from "../palette.ts";
import type { Limb } from "./figure.ts";
import { LimbTexture, LIMBS_PER_ROW, roomFor, TEXELS_PER_LIMB } from "./limb_texture.ts";

/** How opaque somebody is drawn by state: who is only predicted or not yet confirmed is a veil of pixels. */
const TENTATIVE_OPACITY = 0.45;
const COASTING_OPACITY = 0.55;
/** Share by which those are dimmed who are not followed while somebody is. */
const DIMMED = 0.25;
/** Beyond so many people limbs have fewer corners, and small ones are left out. */
const MANY_PERSONS = 24;
/** Beyond so many they have fewer corners where the processor draws. */
const MANY_FOR_SOFTWARE = 10;
/** Thickness of limbs when bones are shown instead of bodies. */
const BONE_SHARE = 0.3;
/** Length of a dash with the gap behind it, metres: a foot has two. */
const DASH_M = "0.1";

export type Colouring = "person" | "sigma";

const LIMB_GLSL = /* glsl */ `
  attribute float corner;  // 2 x limb, and 1 for the far end
  uniform highp sampler2D limbs;
  uniform float thickness;

  struct Limb { vec4 from; vec4 to; vec4 side; vec4 colours; float end; };

  // Ends and radii; direction of the width, depth as a share of it; colours.
  Limb limbOfCorner() {
    int index = int(corner);
    int limb = index / 2;
    ivec2 at = ivec2(${TEXELS_PER_LIMB} * (limb % ${LIMBS_PER_ROW}), limb / ${LIMBS_PER_ROW});
    return Limb(
      texelFetch(limbs, at, 0),
      texelFetch(limbs, at + ivec2(1, 0), 0),
      texelFetch(limbs, at + ivec2(2, 0), 0),
      texelFetch(limbs, at + ivec2(3, 0), 0),
      float(index - 2 * limb));
  }

  // The unit capsule's corner, and its normal.
  vec3 limbPoint(Limb limb, out vec3 normal) {
    vec3 along = limb.to.xyz - limb.from.xyz;
    float length_m = length(along);
    vec3 z = length_m > 1e-5 ? along / length_m : vec3(0.0, 0.0, 1.0);
    vec3 guess = dot(limb.side.xyz, limb.side.xyz) > 1e-8 ? limb.side.xyz : (abs(z.x) < 0.8 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0));
    vec3 x = normalize(guess - z * dot(guess, z));
    vec3 y = cross(z, x);
    float radius_m = mix(limb.from.w, limb.to.w, limb.end) * thickness;
    float depth = mix(1.0, limb.side.w, step(0.5, thickness));
    normal = normalize(x * position.x + y * (position.y / depth) + z * position.z);
    return mix(limb.from.xyz, limb.to.xyz, limb.end) + radius_m * (x * position.x + y * (position.y * depth) + z * position.z);
  }
`;

const BODY_VERTEX = /* glsl */ `
  ${LIMB_GLSL}
  varying vec4 vColour;
  varying vec3 vNormal;
  varying vec3 vToEye;
  varying float vDashes;  // along the limb; 0 where it is not dashed
  void main() {
    Limb limb = limbOfCorner();
    vDashes = limb.colours.w * limb.end * distance(limb.from.xyz, limb.to.xyz) / ${DASH_M};
    vec3 point = limbPoint(limb, vNormal);
    // Red, green and blue are 24 bits of one number.
    float packed = mix(limb.colours.x, limb.colours.y, limb.end);
    vec3 colour = vec3(floor(packed / 65536.0), mod(floor(packed / 256.0), 256.0), mod(packed, 256.0)) / 255.0;
    vColour = vec4(colour, limb.colours.z);
    vToEye = cameraPosition - point;
    gl_Position = projectionMatrix * viewMatrix * vec4(point, 1.0);
  }
`;

const BODY_FRAGMENT = /* glsl */ `
  uniform vec3 sun;
  uniform vec3 rim;
  varying vec4 vColour;
  varying vec3 vNormal;
  varying vec3 vToEye;
  varying float vDashes;
  void main() {
    if (fract(vDashes) > 0.5) discard;
    // A veil of pixels instead of blending: no order of drawing to keep.
    if (vColour.a < 0.99) {
      vec2 cell = mod(floor(gl_FragCoord.xy), 2.0);
      float threshold = (cell.x + 2.0 * abs(cell.x - cell.y) + 0.5) / 4.0;
      if (vColour.a < threshold) discard;
    }
    vec3 normal = normalize(vNormal);
    float lit = 0.5 + 0.5 * dot(normal, sun);
    float sky = 0.5 + 0.5 * normal.z;
    float edge = 1.0 - max(0.0, dot(normal, normalize(vToEye)));
    vec3 colour = vColour.rgb * (0.42 + 0.52 * lit * lit + 0.16 * sky);
    gl_FragColor = vec4(colour + rim * edge * edge * edge, 1.0);
  }
`;

const SHADOW_VERTEX = /* glsl */ `
  ${LIMB_GLSL}
  uniform vec3 sun;
  uniform float floorHeight;
  void main() {
    vec3 normal;
    vec3 point = limbPoint(limbOfCorner(), normal);
    float above = max(0.0, point.z - floorHeight);
    vec3 shadow = vec3(point.xy - sun.xy / sun.z * above, floorHeight);
    gl_Position = projectionMatrix * viewMatrix * vec4(shadow, 1.0);
  }
`;

const SHADOW_FRAGMENT = /* glsl */ `
  uniform vec3 colour;
  void main() { gl_FragColor = vec4(colour, 1.0); }
`;

/** Direction to the light. */
const SUN = new Vector3(0.35, -0.45, 0.82).normalize();

/** Corners around a ring, and rings a half, of the capsules that limbs are drawn as. */
const FINE = [10, 3] as const;
const COARSE = [6, 2] as const;
/** For shadows, of which only the outline is seen. */
const FLAT = [6, 1] as const;

export class Bodies {
  readonly mesh = new Mesh();
  readonly shadow = new Mesh();
  colouring: Colouring = "person";
  private readonly fewLimbs: readonly Limb[];
  private readonly table = new LimbTexture();
  private readonly fine = new Capsules(...FINE);
  private readonly coarse = new Capsules(...COARSE);
  private readonly flat = new Capsules(...FLAT);
  private readonly body: ShaderMaterial;
  private readonly ground: ShaderMaterial;
  private guesses = 0;

  /** `isSoftwareDrawn`: there is no graphics processor. */
  constructor(
    private readonly limbs: readonly Limb[],
    private readonly determined: Determined,
    floor_m: number,
    private readonly isSoftwareDrawn: boolean,
  ) {
    this.fewLimbs = limbs.filter((limb) => !limb.isDetail);
    const thickness = { value: 1 };
    const table = this.table.uniform;
    this.body = new ShaderMaterial({
      vertexShader: BODY_VERTEX,
      fragmentShader: BODY_FRAGMENT,
      uniforms: { sun: { value: SUN }, rim: { value: new Color(0) }, thickness, limbs: table },
    });
    this.ground = new ShaderMaterial({
      vertexShader: SHADOW_VERTEX,
      fragmentShader: SHADOW_FRAGMENT,
      uniforms: { sun: { value: SUN }, colour: { value: new Color(0) }, floorHeight: { value: floor_m + 0.004 }, thickness, limbs: table },
      // On the floor it must lie under the lines, which are drawn after it.
      depthWrite: false,
    });
    this.mesh.material = this.body;
    this.shadow.material = this.ground;
    this.shadow.renderOrder = -2;
    // People stand all over the field, the geometry's own bounds mean nothing.
    this.mesh.frustumCulled = false;
    this.shadow.frustumCulled = false;
  }

  setTheme(shadow: number, rim: number): void {
    (this.ground.uniforms["colour"]?.value as Color).set(shadow).convertLinearToSRGB();
    (this.body.uniforms["rim"]?.value as Color).set(rim).convertLinearToSRGB();
  }

  showBones(isOn: boolean): void {
    const thickness = this.body.uniforms["thickness"];
    if (thickness !== undefined) thickness.value = isOn ? BONE_SHARE : 1;
  }

  /** Whether a limb was dashed when people were drawn last. */
  get areGuessesDrawn(): boolean {
    return this.guesses > 0;
  }

  /** Brings the meshes to these people; `followed` stands out. */
  update(people: People, followed: number | null): void {
    this.guesses = 0;
    const isMany = people.count > MANY_PERSONS;
    const limbs = isMany ? this.fewLimbs : this.limbs;
    const count = people.count * limbs.length;
    this.table.resize(count);
    let at = 0;
    for (let i = 0; i < people.count; i++) {
      const isDimmed = followed !== null && people.ids[i] !== followed;
      for (const limb of limbs) this.write(at++, people, i, limb, isDimmed);
    }
    this.table.written();
    const isCoarse = people.count > (this.isSoftwareDrawn ? MANY_FOR_SOFTWARE : MANY_PERSONS);
    this.mesh.geometry = (isCoarse ? this.coarse : this.fine).geometryOf(count);
    this.shadow.geometry = this.flat.geometryOf(count);
  }

  private write(at: number, people: People, person: number, limb: Limb, isDimmed: boolean): void {
    const joints = people.joints_m;
    const first = person * people.jointCount;
    const a = 3 * (first + limb.from);
    const b = 3 * (first + limb.to);
    const numbers = this.table.numbers;
    const firstNumber = 4 * TEXELS_PER_LIMB * at;
    for (let axis = 0; axis < 3; axis++) {
      const start = joints[a + axis] ?? 0;
      const end = joints[b + axis] ?? 0;
      numbers[firstNumber + axis] = start;
      numbers[firstNumber + 4 + axis] = end + (end - start) * limb.extend;
      numbers[firstNumber + 8 + axis] =
        limb.sideFrom < 0
          ? 0
          : (joints[3 * (first + limb.sideTo) + axis] ?? 0) - (joints[3 * (first + limb.sideFrom) + axis] ?? 0);
    }
    numbers[firstNumber + 3] = limb.fromRadius_m;
    numbers[firstNumber + 7] = limb.toRadius_m;
    numbers[firstNumber + 11] = limb.depth;
    const state = people.states[person] ?? 0;
    const isGuess = this.determined.isGuess(people, person, limb.from) || this.determined.isGuess(people, person, limb.to);
    if (isGuess) this.guesses++;
    const isBySigma = this.colouring === "sigma" && !isGuess;
    const plain = isGuess ? GUESS_COLOUR : personColour(people.ids[person] ?? 0);
    const colourA = isBySigma ? sigmaColour(people.sigma_m[first + limb.from] ?? NaN) : plain;
    const colourB = isBySigma ? sigmaColour(people.sigma_m[first + limb.to] ?? NaN) : plain;
    numbers[firstNumber + 12] = isDimmed ? dimmed(colourA) : colourA;
    numbers[firstNumber + 13] = isDimmed ? dimmed(colourB) : colourB;
    numbers[firstNumber + 14] = state === TENTATIVE ? TENTATIVE_OPACITY : state === COASTING ? COASTING_OPACITY : 1;
    numbers[firstNumber + 15] = isGuess ? 1 : 0;
  }
}

/** Unit capsules one after the other, with `around` corners a ring and `rings` rings a half: one for each limb. */
class Capsules {
  private geometry = new BufferGeometry();
  private room = 0;

  constructor(
    private readonly around: number,
    private readonly rings: number,
  ) {}

  /** Those of `limbs` limbs. */
  geometryOf(limbs: number): BufferGeometry {
    if (limbs > this.room) this.make(roomFor(limbs));
    this.geometry.setDrawRange(0, limbs * this.cornersPerLimb());
    return this.geometry;
  }

  private cornersPerLimb(): number {
    return 6 * this.around * (2 * this.rings + 1);
  }

  private make(room: number): void {
    const { around, rings } = this;
    const points = 2 * (rings + 1) * around;
    const normals = new Int8Array(4 * points * room);
    const ends = new Float32Array(points * room);
    const indices = new Uint32Array(this.cornersPerLimb() * room);
    let at = 0;
    for (let limb = 0; limb < room; limb++) {
      for (let ring = 0; ring < 2 * (rings + 1); ring++) {
        const end = ring > rings ? 1 : 0;
        const polar = ((end === 0 ? ring - rings : ring - rings - 1) / rings) * (Math.PI / 2);
        for (let k = 0; k < around; k++) {
          const turn = (2 * Math.PI * k) / around;
          const point = limb * points + ring * around + k;
          normals[4 * point] = Math.round(127 * Math.cos(polar) * Math.cos(turn));
          normals[4 * point + 1] = Math.round(127 * Math.cos(polar) * Math.sin(turn));
          normals[4 * point + 2] = Math.round(127 * Math.sin(polar));
          ends[point] = 2 * limb + end;
          if (ring === 0) continue;
          const low = point - around;
          const next = low - k + ((k + 1) % around);
          for (const index of [low, next, point, next, next + around, point]) indices[at++] = index;
        }
      }
    }
    this.geometry.dispose();
    this.geometry = new BufferGeometry();
    this.geometry.setAttribute("position", new BufferAttribute(normals, 4, true));
    this.geometry.setAttribute("corner", new BufferAttribute(ends, 1));
    this.geometry.setIndex(new BufferAttribute(indices, 1));
    this.room = room;
  }
}

/** Somebody else's colour while one is followed. */
function dimmed(colour: number): number {
  return mix(colour, 0x6b7280, DIMMED * 2);
}
