// What a projector's primary rays found, by sample plane. A hit is stored as (instance, triangle) alone: ray and triangle give
// distance and barycentrics again in full precision for less than the memory traffic of storing them.
#ifndef PRIMARY_HIT_GLSL
#define PRIMARY_HIT_GLSL

#include "surface.glsl"
#include "primary_ray.glsl"
#include "random.glsl"

layout(push_constant) uniform Push {
    uint sample_index; // which plane
    uint projector;    // of blending and of the room view: whose light
} push;

uint pixel_index(uvec2 pixel) {
    return pixel.y * uint(frame.frustum.resolution_px.x) + pixel.x;
}

uvec2 pixel_of(uint index) {
    uint width = uint(frame.frustum.resolution_px.x);
    return uvec2(index % width, index / width);
}

bool outside_image(uvec2 pixel) {
    return pixel.x >= uint(frame.frustum.resolution_px.x) || pixel.y >= uint(frame.frustum.resolution_px.y);
}

// The primary ray of a sample; t_max < 0 where there is none.
Ray sample_ray(uvec2 pixel, uint s) {
    Ray ray;
    ray.t_min = 0.0;
    vec2 at_px = vec2(pixel) + sample_offset(pixel, s);
    bool lit = own_ideal(at_px);
    frustum_ray(frame.frustum, at_px, ray.origin, ray.direction, ray.t_max);
    ray.t_max = lit ? ray.t_max : -1.0;
    return ray;
}

// Barycentrics of a ray that is known to meet this triangle. It is not asked again whether: another pipeline may round otherwise.
vec2 meet_again(Ray ray, uint instance, uint triangle) {
    int at = (int(instance_words(instance).triangle_base) + int(triangle)) * 3;
    vec4 row0, row1, row2;
    instance_rows(instance, 3, row0, row1, row2);
    vec3 direction = transform_vector(row0, row1, row2, ray.direction);
    vec3 e1 = LOAD(triangles, at + 1).xyz;
    vec3 e2 = LOAD(triangles, at + 2).xyz;
    vec3 s = transform_point(row0, row1, row2, ray.origin) - LOAD(triangles, at).xyz;
    vec3 p = cross(direction, e2);
    float det = dot(e1, p);
    vec2 barycentric = det == 0.0 ? vec2(0.0) : vec2(dot(s, p), dot(direction, cross(s, e1))) / det;
    barycentric = max(barycentric, vec2(0.0));
    return barycentric / max(barycentric.x + barycentric.y, 1.0);
}

// The surface that a primary ray met, both normals turned to the side that the projector lights.
Surface lit_surface(Ray ray, uvec2 found, out bool from_inside) {
    Surface s = surface_at(found.x, found.y, meet_again(ray, found.x, found.y));
    from_inside = turn_to(s, ray.direction);
    return s;
}

#endif
