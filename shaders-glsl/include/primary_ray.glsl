// Primary rays: homogeneous unprojected corners, interpolated, then divided (DESIGN section 2; PAPER.md, Ray Generation, divides
// first, which is exact only while w is constant on the near plane).
#ifndef PRIMARY_RAY_GLSL
#define PRIMARY_RAY_GLSL

// The ray through a point of the image, px: from the near plane, unit direction, to the far plane. t_max < 0 where there is none.
void frustum_ray(GpuFrustum f, vec2 at_px, out vec3 origin, out vec3 direction, out float t_max) {
    vec4 near = f.near_00 + at_px.x * f.near_dx + at_px.y * f.near_dy;
    vec4 far = f.far_00 + at_px.x * f.far_dx + at_px.y * f.far_dy;
    origin = near.xyz / near.w;

    // far/far.w − near/near.w without the division by far.w, which is 0 where the far plane is infinitely far.
    vec3 along = far.xyz - far.w * origin;
    float span = length(along);
    direction = along / span;
    t_max = near.w <= 0.0 ? -1.0 : (far.w > 0.0 ? span / far.w : 3.0e38);
}

// Where a world point (relative to the origin) falls in the image, px, and its clip w.
vec2 project_px(GpuFrustum f, vec3 p, out float clip_w) {
    vec4 h = vec4(p, 1.0);
    clip_w = dot(f.clip_w, h);
    vec2 ndc = vec2(dot(f.clip_x, h), dot(f.clip_y, h)) / clip_w;
    return (vec2(ndc.x, ndc.y * f.y_sign) * 0.5 + 0.5) * f.resolution_px;
}

// Window z of a world point by the projector's own depth convention (PAPER.md equations 5 to 7). Arranged as base + gap/w, where
// the gap vanishes at the far plane, so that nothing cancels where depth is close to 1.
float window_z(GpuFrustum f, vec3 p) {
    vec4 h = vec4(p, 1.0);
    return f.z_base + dot(f.depth_row, h) / dot(f.clip_w, h);
}

#endif
