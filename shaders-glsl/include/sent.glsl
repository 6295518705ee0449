// What a projector sends, before it is encoded: its share of the light, its alpha and beta maps applied.
#ifndef SENT_GLSL
#define SENT_GLSL

// Whether the projector has alpha and beta maps: three words a pixel, six numbers of 16 bits from 0 to 1.
layout(constant_id = 11) const uint MAPPED = 0u;
layout(std430, binding = 41) readonly buffer Maps { uint maps[]; };

// MPCDI: in · alpha · (1 − beta) + beta, on linear values.
vec3 mapped(uint index, vec3 linear) {
    vec2 a = unpackUnorm2x16(maps[3u * index]);
    vec2 b = unpackUnorm2x16(maps[3u * index + 1u]);
    vec2 c = unpackUnorm2x16(maps[3u * index + 2u]);
    vec3 beta = vec3(b.y, c);
    return linear * vec3(a, b.x) * (1.0 - beta) + beta;
}

// Linear light from 0 to 1, of linear radiance and weight.
vec3 sent_light(uint index, vec4 radiance_and_weight) {
    vec3 sent = clamp(radiance_and_weight.rgb * radiance_and_weight.a, vec3(0.0), vec3(1.0));
    if (MAPPED != 0u) {
        sent = mapped(index, sent);
    }
    return sent;
}

float linear_to_srgb(float c) {
    return c <= 0.0031308 ? c * 12.92 : 1.055 * pow(c, 1.0 / 2.4) - 0.055;
}

vec3 encode_srgb(vec3 linear) {
    return vec3(linear_to_srgb(linear.r), linear_to_srgb(linear.g), linear_to_srgb(linear.b));
}

#endif
