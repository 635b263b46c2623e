// People as solid bodies: all limbs of all people are one instanced mesh, and their shadows on the floor another.
//
// A limb is a capsule whose ends, radii and flatness are per-instance numbers; the vertex shader builds it. So the
// processor writes 20 numbers a limb and makes no matrix, and nothing is allocated once the meshes stand.

import {
  DynamicDrawUsage,
  InstancedBufferAttribute,
  InstancedBufferGeometry,
  BufferAttribute,
  Color,
  Mesh,
  ShaderMaterial,
  Vector3,
} from "three";
import { COASTING, MOST_PERSONS, TENTATIVE, type People } from "../protocol/ticks.ts";
import { mix, personColour, sigmaColour } from "../palette.ts";
import type { Limb } from "./figure.ts";

/** How opaque somebody is drawn by state: who is only predicted or not yet confirmed is a veil of pixels. */
const TENTATIVE_OPACITY = 0.45;
const COASTING_OPACITY = 0.55;
/** Share by which those are dimmed who are not followed while somebody is. */
const DIMMED = 0.25;
/** Beyond so many people limbs have fewer corners, and small ones are left out. */
const MANY_PERSONS = 24;
/** Thickness of limbs when bones are shown instead of bodies. */
const BONE_SHARE = 0.3;

export type Colouring = "person" | "sigma";

const LIMB_GLSL = /* glsl */ `
  attribute vec4 limbFrom;  // xyz, radius
  attribute vec4 limbTo;
  attribute vec4 limbSide;  // direction of the width, depth as a share of it
  attribute vec4 colourFrom;
  attribute vec4 colourTo;
  uniform float thickness;

  // The unit capsule's corner: its normal, and 0 or 1 for the end it belongs to.
  vec3 limbPoint(out vec3 normal, out float end) {
    end = step(0.5, uv.x);
    vec3 along = limbTo.xyz - limbFrom.xyz;
    float length_m = length(along);
    vec3 z = length_m > 1e-5 ? along / length_m : vec3(0.0, 0.0, 1.0);
    vec3 guess = dot(limbSide.xyz, limbSide.xyz) > 1e-8 ? limbSide.xyz : (abs(z.x) < 0.8 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0));
    vec3 x = normalize(guess - z * dot(guess, z));
    vec3 y = cross(z, x);
    float radius_m = mix(limbFrom.w, limbTo.w, end) * thickness;
    float depth = mix(1.0, limbSide.w, step(0.5, thickness));
    normal = normalize(x * position.x + y * (position.y / depth) + z * position.z);
    return mix(limbFrom.xyz, limbTo.xyz, end) + radius_m * (x * position.x + y * (position.y * depth) + z * position.z);
  }
`;

const BODY_VERTEX = /* glsl */ `
  ${LIMB_GLSL}
  varying vec4 vColour;
  varying vec3 vNormal;
  varying vec3 vToEye;
  void main() {
    float end;
    vec3 point = limbPoint(vNormal, end);
    vColour = mix(colourFrom, colourTo, end);
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
  void main() {
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
    float end;
    vec3 point = limbPoint(normal, end);
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

export class Bodies {
  readonly mesh: Mesh;
  readonly shadow: Mesh;
  colouring: Colouring = "person";
  private readonly fewLimbs: readonly Limb[];
  private readonly from: InstancedBufferAttribute;
  private readonly to: InstancedBufferAttribute;
  private readonly side: InstancedBufferAttribute;
  private readonly colourFrom: InstancedBufferAttribute;
  private readonly colourTo: InstancedBufferAttribute;
  private readonly attributes: readonly InstancedBufferAttribute[];
  private readonly fine: InstancedBufferGeometry;
  private readonly coarse: InstancedBufferGeometry;
  /** For shadows, of which only the outline is seen. */
  private readonly flat: InstancedBufferGeometry;
  private readonly body: ShaderMaterial;
  private readonly ground: ShaderMaterial;

  constructor(private readonly limbs: readonly Limb[], floor_m: number) {
    this.fewLimbs = limbs.filter((limb) => !limb.isDetail);
    const instances = limbs.length * MOST_PERSONS;
    this.from = floats(instances);
    this.to = floats(instances);
    this.side = floats(instances);
    this.colourFrom = bytes(instances);
    this.colourTo = bytes(instances);
    this.attributes = [this.from, this.to, this.side, this.colourFrom, this.colourTo];
    this.fine = this.geometry(10, 3);
    this.coarse = this.geometry(6, 2);
    this.flat = this.geometry(6, 1);
    const thickness = { value: 1 };
    this.body = new ShaderMaterial({
      vertexShader: BODY_VERTEX,
      fragmentShader: BODY_FRAGMENT,
      uniforms: { sun: { value: SUN }, rim: { value: new Color(0) }, thickness },
    });
    this.ground = new ShaderMaterial({
      vertexShader: SHADOW_VERTEX,
      fragmentShader: SHADOW_FRAGMENT,
      uniforms: { sun: { value: SUN }, colour: { value: new Color(0) }, floorHeight: { value: floor_m + 0.004 }, thickness },
      // On the floor it must lie under the lines, which are drawn after it.
      depthWrite: false,
    });
    this.mesh = new Mesh(this.fine, this.body);
    this.shadow = new Mesh(this.flat, this.ground);
    this.shadow.renderOrder = -2;
    // The instances stand all over the field, the geometry's own bounds mean nothing.
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

  /** Brings the meshes to these people; `followed` stands out. */
  update(people: People, followed: number | null): void {
    let at = 0;
    const isMany = people.count > MANY_PERSONS;
    for (let i = 0; i < people.count; i++) {
      const isDimmed = followed !== null && people.ids[i] !== followed;
      for (const limb of isMany ? this.fewLimbs : this.limbs) this.write(at++, people, i, limb, isDimmed);
    }
    const geometry = isMany ? this.coarse : this.fine;
    this.mesh.geometry = geometry;
    geometry.instanceCount = at;
    this.flat.instanceCount = at;
    for (const attribute of this.attributes) {
      attribute.clearUpdateRanges();
      attribute.addUpdateRange(0, 4 * at);
      attribute.needsUpdate = true;
    }
  }

  private write(at: number, people: People, person: number, limb: Limb, isDimmed: boolean): void {
    const joints = people.joints_m;
    const first = person * people.jointCount;
    const a = 3 * (first + limb.from);
    const b = 3 * (first + limb.to);
    const from = this.from.array;
    const to = this.to.array;
    const side = this.side.array;
    for (let axis = 0; axis < 3; axis++) {
      const start = joints[a + axis] ?? 0;
      const end = joints[b + axis] ?? 0;
      from[4 * at + axis] = start;
      to[4 * at + axis] = end + (end - start) * limb.extend;
      side[4 * at + axis] =
        limb.sideFrom < 0
          ? 0
          : (joints[3 * (first + limb.sideTo) + axis] ?? 0) - (joints[3 * (first + limb.sideFrom) + axis] ?? 0);
    }
    from[4 * at + 3] = limb.fromRadius_m;
    to[4 * at + 3] = limb.toRadius_m;
    side[4 * at + 3] = limb.depth;
    const state = people.states[person] ?? 0;
    const opacity = state === TENTATIVE ? TENTATIVE_OPACITY : state === COASTING ? COASTING_OPACITY : 1;
    const isBySigma = this.colouring === "sigma";
    const plain = personColour(people.ids[person] ?? 0);
    const colourA = isBySigma ? sigmaColour(people.sigma_m[first + limb.from] ?? NaN) : plain;
    const colourB = isBySigma ? sigmaColour(people.sigma_m[first + limb.to] ?? NaN) : plain;
    put(this.colourFrom.array, 4 * at, colourA, opacity, isDimmed);
    put(this.colourTo.array, 4 * at, colourB, opacity, isDimmed);
  }

  /** A unit capsule with `around` corners a ring and `rings` rings a half, on which the shared instances are drawn. */
  private geometry(around: number, rings: number): InstancedBufferGeometry {
    const normals: number[] = [];
    const ends: number[] = [];
    const corners: number[] = [];
    for (let ring = 0; ring < 2 * (rings + 1); ring++) {
      const end = ring > rings ? 1 : 0;
      const polar = ((end === 0 ? ring - rings : ring - rings - 1) / rings) * (Math.PI / 2);
      for (let k = 0; k < around; k++) {
        const turn = (2 * Math.PI * k) / around;
        normals.push(Math.cos(polar) * Math.cos(turn), Math.cos(polar) * Math.sin(turn), Math.sin(polar));
        ends.push(end, 0);
        if (ring > 0) {
          const [low, next] = [(ring - 1) * around, (k + 1) % around];
          corners.push(low + k, low + next, low + around + k, low + next, low + around + next, low + around + k);
        }
      }
    }
    const geometry = new InstancedBufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(normals), 3));
    geometry.setAttribute("uv", new BufferAttribute(new Float32Array(ends), 2));
    geometry.setIndex(corners);
    geometry.setAttribute("limbFrom", this.from);
    geometry.setAttribute("limbTo", this.to);
    geometry.setAttribute("limbSide", this.side);
    geometry.setAttribute("colourFrom", this.colourFrom);
    geometry.setAttribute("colourTo", this.colourTo);
    geometry.instanceCount = 0;
    return geometry;
  }
}

function floats(instances: number): InstancedBufferAttribute {
  const attribute = new InstancedBufferAttribute(new Float32Array(4 * instances), 4);
  return attribute.setUsage(DynamicDrawUsage) as InstancedBufferAttribute;
}

function bytes(instances: number): InstancedBufferAttribute {
  const attribute = new InstancedBufferAttribute(new Uint8Array(4 * instances), 4, true);
  return attribute.setUsage(DynamicDrawUsage) as InstancedBufferAttribute;
}

function put(target: { [index: number]: number }, at: number, colour: number, opacity: number, isDimmed: boolean): void {
  const shown = isDimmed ? mix(colour, 0x6b7280, DIMMED * 2) : colour;
  target[at] = (shown >> 16) & 255;
  target[at + 1] = (shown >> 8) & 255;
  target[at + 2] = shown & 255;
  target[at + 3] = Math.round(255 * opacity);
}
