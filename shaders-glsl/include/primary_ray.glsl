// Primary rays: homogeneous unprojected corners, interpolated, then divided (DESIGN section 2; PAPER.md, Ray Generation, divides
// first, which is exact only while w is constant on the near plane).
#ifndef PRIMARY_RAY_GLSL
#define PRIMARY_RAY_GLSL

#include "lens.glsl"

// The ray through a point of the ideal image, px: from the near plane, unit direction, to the far plane. t_max < 0 where there is none.
void frustum_ray(GpuFrustum f, vec2 at_px, out vec3 origin, out vec3 direction, out float t_max) {
    vec4 near = f.near_00 + at_px.x * f.near_dx + at_px.y * f.near_dy;
    origin = near.xyz / near.w;
    direction = normalize(f.far_00.xyz + at_px.x * f.far_dx.xyz + at_px.y * f.far_dy.xyz);

    // The depth functional is ∓w at the near plane, vanishes at the far one and is linear between.
    float to_far = (2.0 * f.z_base - 1.0) * dot(f.depth_row.xyz, direction) * near.w;
    t_max = near.w <= 0.0 ? -1.0 : (to_far > 0.0 ? 1.0 / to_far : 3.0e38);
}

// The place in its own projector's ideal image of one in the real one, px; false where no light goes.
bool own_ideal(inout vec2 at_px) {
    return OWN_LENS == 0u || to_ideal(lenses[setup.projector_index], at_px);
}

// Where a world point (relative to the origin) falls in the ideal image, px, and its clip w.
vec2 project_px(GpuFrustum f, vec3 p, out float clip_w) {
    vec4 h = vec4(p, 1.0);
    clip_w = dot(f.clip_w, h);
    vec2 ndc = vec2(dot(f.clip_x, h), dot(f.clip_y, h)) / clip_w;
    return (vec2(ndc.x, ndc.y * f.y_sign) * 0.5 + 0.5) * f.resolution_px;
}

// Window z at a distance along the ray through a point of the ideal image, by the projector's own depth convention (PAPER.md equations 4
// to 7). Clip w and the depth functional are linear along a ray, so the point itself, and its rounding, are not needed.
float window_z(GpuFrustum f, vec2 at_px, vec3 direction, float distance_m) {
    float w_near = 1.0 / (f.near_00.w + at_px.x * f.near_dx.w + at_px.y * f.near_dy.w);
    float gap = distance_m * dot(f.depth_row.xyz, direction) - (2.0 * f.z_base - 1.0) * w_near;
    return f.z_base + gap / (w_near + distance_m * dot(f.clip_w.xyz, direction));
}

#endif
