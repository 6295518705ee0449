// What a miss sees: an equirectangular map, −Z in its middle, row 0 on top (CONTRACT, Config).
#ifndef ENVIRONMENT_GLSL
#define ENVIRONMENT_GLSL

vec3 environment_texel(ivec2 at) {
    ivec2 size = ivec2(setup.environment_px);
    at.x = at.x < 0 ? at.x + size.x : (at.x >= size.x ? at.x - size.x : at.x);
    at.y = clamp(at.y, 0, size.y - 1);
    return LOAD(environment_texels, int(setup.environment_first) + at.y * size.x + at.x).rgb;
}

// Linear radiance from a direction, bilinear, wrapping around the horizon.
vec3 environment_radiance(vec3 d) {
    const float PI = 3.14159265358979;
    vec2 uv = vec2(0.5 + atan(d.x, -d.z) / (2.0 * PI), acos(clamp(d.y, -1.0, 1.0)) / PI);
    vec2 at = uv * vec2(setup.environment_px) - 0.5;
    ivec2 base = ivec2(floor(at));
    vec2 f = at - vec2(base);
    return mix(mix(environment_texel(base), environment_texel(base + ivec2(1, 0)), f.x),
               mix(environment_texel(base + ivec2(0, 1)), environment_texel(base + ivec2(1, 1)), f.x), f.y);
}

// What a white diffuse surface of this normal shows under the whole environment (Ramamoorthi and Hanrahan, SIGGRAPH 2001).
vec3 irradiance_over_pi(vec3 n) {
    vec3 sum = frame.irradiance[0].rgb + frame.irradiance[1].rgb * n.y + frame.irradiance[2].rgb * n.z +
               frame.irradiance[3].rgb * n.x + frame.irradiance[4].rgb * (n.x * n.y) + frame.irradiance[5].rgb * (n.y * n.z) +
               frame.irradiance[6].rgb * (3.0 * n.z * n.z - 1.0) + frame.irradiance[7].rgb * (n.x * n.z) +
               frame.irradiance[8].rgb * (n.x * n.x - n.y * n.y);
    return max(sum, vec3(0.0));
}

#endif
