import type { Hemilux } from "./index.js";

/** Light sets as three.js lights. Give it the three.js module, so that one three.js is in use. */
export class ProbeLights<Group = unknown> {
  constructor(THREE: object, most?: number, options?: { exposure?: number; distance?: number; castShadow?: boolean; soft?: boolean; occluder?: number });
  exposure: number;
  distance: number;
  /** Whether lights are discs: their irradiance, and the width of `shadow.radius`, follow from their radius. */
  soft: boolean;
  /** Distance between an occluder and the shadowed surface for which the penumbra is right, scene units. */
  occluder: number;
  /** To be added to a scene. */
  group: Group;
  /** Shows the lights of this moment. The probe must have been asked for `coordinates: "three"`. */
  update(probe: Pick<Hemilux, "latest" | "interpolated">, now?: number): void;
}
