// The limbs of all people as a texture, which the vertex shader reads: four texels a limb.

import { DataTexture, FloatType, NearestFilter, RGBAFormat } from "three";

export const TEXELS_PER_LIMB = 4;
export const LIMBS_PER_ROW = 64;
/** Limbs for which there is room at first. */
const FIRST_ROOM = 512;

/** Room that is made for `limbs`: twice as much each time, so that it is seldom made. */
export function roomFor(limbs: number): number {
  let room = FIRST_ROOM;
  while (room < limbs) room *= 2;
  return room;
}

export class LimbTexture {
  /** What shaders read: it stays, whatever texture is in it. */
  readonly uniform: { value: DataTexture };
  /** Limb by limb: from, radius; to, radius; direction of the width, depth; colours of both ends as 0xrrggbb, opacity, 1 where it is dashed. */
  numbers: Float32Array;
  private room = FIRST_ROOM;

  constructor() {
    this.numbers = numbersFor(FIRST_ROOM);
    this.uniform = { value: textureOf(this.numbers) };
  }

  /** Makes room for `limbs`; what is in it is lost where there was too little. */
  resize(limbs: number): void {
    if (limbs <= this.room) return;
    this.room = roomFor(limbs);
    this.numbers = numbersFor(this.room);
    this.uniform.value.dispose();
    this.uniform.value = textureOf(this.numbers);
  }

  /** Everything has been written. */
  written(): void {
    this.uniform.value.needsUpdate = true;
  }
}

function numbersFor(limbs: number): Float32Array {
  return new Float32Array(4 * TEXELS_PER_LIMB * limbs);
}

function textureOf(numbers: Float32Array): DataTexture {
  const rows = numbers.length / (4 * TEXELS_PER_LIMB * LIMBS_PER_ROW);
  const texture = new DataTexture(numbers, TEXELS_PER_LIMB * LIMBS_PER_ROW, rows, RGBAFormat, FloatType);
  texture.magFilter = texture.minFilter = NearestFilter;
  return texture;
}
