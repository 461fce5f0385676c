import type { Hemilux } from "./index.js";

/** Light sets as three.js lights. The first argument is the three.js module of the page, so that only one copy is used. */
export class ProbeLights<Group = unknown> {
  constructor(THREE: object, most?: number, options?: { exposure?: number; distance?: number; castShadow?: boolean; soft?: boolean; occluder?: number });
  exposure: number;
  distance: number;
  /** True if lights are discs: irradiance and `shadow.radius` follow from their radius. */
  soft: boolean;
  /** Distance between an occluder and the shadowed surface for which the penumbra is exact, scene units. */
  occluder: number;
  /** The three.js object with all lights, to be added to a scene. */
  group: Group;
  /** Updates the lights to this time. The probe must have been created with `coordinates: "three"`. */
  update(probe: Pick<Hemilux, "latest" | "interpolated">, now?: number): void;
}
