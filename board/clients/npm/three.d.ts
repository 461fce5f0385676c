import type { Hemilux } from "./index.js";

/** Light sets as three.js lights. Give it the three.js module, so that one three.js is in use. */
export class ProbeLights<Group = unknown> {
  constructor(THREE: object, most?: number, options?: { exposure?: number; distance?: number; castShadow?: boolean });
  exposure: number;
  distance: number;
  /** To be added to a scene. */
  group: Group;
  /** Shows the lights of this moment. The probe must have been asked for `coordinates: "three"`. */
  update(probe: Pick<Hemilux, "latest" | "interpolated">, now?: number): void;
}
