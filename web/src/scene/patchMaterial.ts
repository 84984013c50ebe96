import { Color, DoubleSide, ShaderMaterial, Vector2 } from "three";

export const COLOURS = ["normal", "height", "session", "age", "change"] as const;
export type Colouring = (typeof COLOURS)[number];

// A patch is the cut of its ray cone with its plane: an ellipse that is longer where the plane is seen at a grazing
// angle. `morph` 0 puts it on a sphere around the origin, 1 where its plane meets its ray.
const vertexShader = /* glsl */ `
attribute vec4 center;
attribute vec2 octahedral;
attribute float mark;
uniform float lodScale, morph, sphere, reach, age;
uniform int colouring;
uniform vec2 heights;
uniform vec3 colour;
varying vec3 shade;
varying vec2 corner;

vec3 decoded(vec2 e) {
  vec3 n = vec3(e, 1.0 - abs(e.x) - abs(e.y));
  if (n.z < 0.0) n.xy = (1.0 - abs(n.yx)) * vec2(n.x >= 0.0 ? 1.0 : -1.0, n.y >= 0.0 ? 1.0 : -1.0);
  return normalize(n);
}

vec3 ramp(float t) {
  vec3 c = mix(vec3(0.27, 0.22, 0.55), vec3(0.14, 0.53, 0.62), smoothstep(0.0, 0.3, t));
  c = mix(c, vec3(0.36, 0.75, 0.45), smoothstep(0.3, 0.6, t));
  return mix(c, vec3(0.98, 0.86, 0.33), smoothstep(0.6, 1.0, t));
}

vec3 facingHue(vec3 n) {
  float azimuth = atan(n.y, n.x);
  return vec3(0.62) + 0.3 * cos(vec3(azimuth) + vec3(0.6, 2.7, 4.8));
}

void main() {
  float range = length(center.xyz);
  vec3 u = center.xyz / range;
  vec3 n = decoded(octahedral);
  vec3 facing = normalize(mix(-u, n, morph));
  vec3 middle = mix(u * sphere, center.xyz, morph);
  vec3 across = cross(facing, u);
  float sine = length(across);
  across = sine > 1e-3 ? across / sine : normalize(cross(facing, abs(facing.z) < 0.9 ? vec3(0, 0, 1) : vec3(1, 0, 0)));
  float half_width = length(middle) * center.w * lodScale;
  float half_length = half_width * min(1.0 / max(abs(dot(facing, u)), 0.01), 5.0 / max(1.0, 0.7 * lodScale));
  if (range > reach) half_width = half_length = 0.0;
  vec3 p = middle + across * position.x * half_width + cross(facing, across) * position.y * half_length;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(p, 1.0);

  vec3 inMap = normalize(mat3(modelMatrix) * n);
  float light = 0.78 + 0.22 * dot(inMap, normalize(vec3(0.4, 0.25, 0.88)));
  vec3 base = colour;
  // What lies is grey; what stands has a hue for the way it faces.
  if (colouring == 0) base = mix(vec3(0.55, 0.59, 0.64), facingHue(inMap), smoothstep(0.35, 0.85, length(inMap.xy)));
  if (colouring == 1) base = ramp(clamp(((modelMatrix * vec4(center.xyz, 1.0)).z - heights.x) / (heights.y - heights.x), 0.0, 1.0));
  if (colouring == 3) base = ramp(age);
  if (colouring == 4) base = mark > 1.5 ? vec3(0.18, 0.75, 0.44) : mark > 0.5 ? vec3(0.9, 0.28, 0.3) : vec3(0.42, 0.46, 0.5);
  shade = base * light;
  corner = position.xy;
}`;

const fragmentShader = /* glsl */ `
varying vec3 shade;
varying vec2 corner;
void main() {
  // A darker rim tells patches of one colour apart.
  gl_FragColor = vec4(shade * (1.0 - 0.24 * smoothstep(0.55, 1.0, length(corner))), 1.0);
}`;

export function makePatchMaterial(): ShaderMaterial {
  return new ShaderMaterial({
    vertexShader,
    fragmentShader,
    side: DoubleSide,
    uniforms: {
      lodScale: { value: 1 },
      morph: { value: 1 },
      sphere: { value: 3 },
      reach: { value: 1e9 },
      age: { value: 0 },
      colouring: { value: 0 },
      heights: { value: new Vector2(-2, 8) },
      colour: { value: new Color("#4c8dd6") },
    },
  });
}
