/** Red, green and blue, linear. */
export type Rgb = [number, number, number];

/** A directional light. */
export interface Light {
  /** Kept from set to set for as long as the light exists. */
  id: number;
  /** Unit vector from the probe towards the light. */
  direction: [number, number, number];
  /** Perpendicular irradiance. */
  irradiance: Rgb;
  /** Angular radius, degrees. */
  radius_deg: number;
  /** Frames since the light appeared. */
  age: number;
  /** Id of the light from which the light was split. */
  parent: number | null;
}

/** The lights of one frame; `board/FORMATS.md` defines each member. */
export interface LightSet {
  version: 1;
  /** Changes at every start of the probe; ids of different runs are unrelated. */
  run: string;
  frame: number;
  timestamp_ns: number;
  wall_ms: number;
  valid: boolean;
  stale: { age_ms: number; reason: string } | null;
  sampler: string;
  requested: number;
  unit: "relative" | "lux";
  coordinates: string;
  lights: Light[];
  /** Nine rows of spherical harmonics, where they were requested. */
  ambient_sh?: Rgb[];
  left_out?: Rgb;
  scalar_flux: Rgb;
  horizontal_irradiance: Rgb;
  clipped: number;
  unseen: number;
  estimated_error: number | null;
  latency_us: Record<string, number>;
  overrun: string[];
}

export type State = "live" | "stale" | "lost";

export interface Options {
  /** Axes of directions and harmonics. */
  coordinates?: "probe" | "blender" | "ros" | "y-up" | "gltf" | "three" | "webxr" | "unity" | "unreal";
  /** Largest number of lights. */
  lights?: number;
  /** Whether diffuse light is returned as spherical harmonics; "own" for the probe's own setting. */
  ambient?: boolean | "own";
  /** Whether lights are fitted as uniform discs of their radius; "own" (the default) for the probe's own setting. */
  soft?: boolean | "own";
}

export interface HemiluxEvents {
  set: CustomEvent<LightSet>;
  state: CustomEvent<State>;
}

/** A connection to a probe, which is opened again whenever it ends. */
export class Hemilux extends EventTarget {
  /** `base` is the probe's address. Throws a TypeError for an invalid address. */
  constructor(base?: string | URL, options?: Options);
  /** The newest set. */
  latest: LightSet | null;
  state: State;
  /** Reason why the state is not "live", one line. */
  reason: string;
  /** Ends the connection for good. */
  close(): void;
  /** Returns the lights at the time `now` of performance.now(), interpolated between the last two sets by id. */
  interpolated(now?: number): Light[];
  addEventListener<K extends keyof HemiluxEvents>(type: K, listener: (event: HemiluxEvents[K]) => void, options?: boolean | AddEventListenerOptions): void;
  addEventListener(type: string, listener: EventListenerOrEventListenerObject | null, options?: boolean | AddEventListenerOptions): void;
}

/** The lights between two sets' lights, `part` 0 to 1. */
export function mix(old: Light[], latest: Light[], part: number): Light[];
