// What stands between a projector's ideal image, which its matrix makes, and the real one, whose pixels shine: twin of
// daemon/calibration/src/lens.rs. Places are px from the top left corner. A projector without a lens pays nothing: its pipelines are made
// without any of this.
#ifndef LENS_GLSL
#define LENS_GLSL

// Whether the projector whose picture is made has a lens, and whether any one has.
layout(constant_id = 9) const uint OWN_LENS = 0u;
layout(constant_id = 10) const uint ANY_LENS = 0u;

const uint LENS_NONE = 0u;
const uint LENS_BROWN_CONRADY = 1u;
const uint LENS_WARP = 2u;
const uint LENS_STEPS = 8u;

// How far from the asked place that may end, ideal px: beyond, the warp does not show it.
const float WARP_RESIDUAL_PX = 0.05;

// Twin of daemon/calibration/src/packed_lens.rs.
struct GpuLens {
    vec2 focal_px;
    vec2 centre_px;
    vec4 k1_k2_p1_p2;
    float k3;
    float reach;             // of the disc of ideal places, focal lengths
    uint kind;               // one of the LENS_ constants
    uint has_alpha;          // an alpha map says what the projector's share is
    uvec2 nodes;             // of the warp
    uvec2 inverse_nodes;     // of the grid that leads back
    vec2 nodes_a_px;
    vec2 inverse_low_px;     // its first node, in the ideal image
    float inverse_step_px;
    uint first_texel;        // of the warp's nodes: ideal place, and 1 where the node is lit
    uint inverse_first_texel; // of the inverse's: real place, and 1 where it is known
};

layout(std430, binding = 42) readonly buffer Lenses { GpuLens lenses[]; };
layout(binding = 37) uniform samplerBuffer lens_texels;

// OpenCV's model, of a place about the centre in focal lengths, and its Jacobian's three numbers (xx, xy, yy).
vec2 distorted(GpuLens l, vec2 at, out vec3 slope) {
    vec4 k = l.k1_k2_p1_p2;
    float r2 = dot(at, at);
    float radial = 1.0 + r2 * (k.x + r2 * (k.y + r2 * l.k3));
    float growth = 2.0 * k.x + r2 * (4.0 * k.y + r2 * 6.0 * l.k3);
    slope = vec3(radial + growth * at.x * at.x + 2.0 * k.z * at.y + 6.0 * k.w * at.x,
                 growth * at.x * at.y + 2.0 * (k.z * at.x + k.w * at.y),
                 radial + growth * at.y * at.y + 6.0 * k.z * at.y + 2.0 * k.w * at.x);
    return at * radial + vec2(2.0 * k.z * at.x * at.y + k.w * (r2 + 2.0 * at.x * at.x),
                              k.z * (r2 + 2.0 * at.y * at.y) + 2.0 * k.w * at.x * at.y);
}

// v with J · v = r, for a symmetric J.
vec2 solve(vec3 j, vec2 r) {
    return vec2(j.z * r.x - j.y * r.y, j.x * r.y - j.y * r.x) / (j.x * j.z - j.y * j.y);
}

vec2 shortened(vec2 v, float longest) {
    float d = length(v);
    return d > longest ? v * (longest / d) : v;
}

// A step of Newton's method toward the place that is distorted to `wanted`, held within the disc.
vec2 toward(GpuLens l, vec2 wanted, vec2 at) {
    vec3 slope;
    vec2 residual = wanted - distorted(l, at, slope);
    return shortened(at + solve(slope, residual), l.reach);
}

// Four texels of a grid around a place counted in nodes, and how far between them it lies.
struct Patch {
    vec4 a, b, c, d;
    vec2 uv;
};

Patch patch_at(uint first_texel, uvec2 nodes, vec2 at_nodes) {
    vec2 first = clamp(floor(at_nodes), vec2(0.0), vec2(nodes) - 2.0);
    int at = int(first_texel) + int(first.y) * int(nodes.x) + int(first.x);
    return Patch(texelFetch(lens_texels, at), texelFetch(lens_texels, at + 1), texelFetch(lens_texels, at + int(nodes.x)),
                 texelFetch(lens_texels, at + int(nodes.x) + 1), at_nodes - first);
}

vec2 bilinear(Patch p) {
    return mix(mix(p.a.xy, p.b.xy, p.uv.x), mix(p.c.xy, p.d.xy, p.uv.x), p.uv.y);
}

// Whether the nearest node is lit.
bool is_lit(Patch p) {
    float top = p.uv.x >= 0.5 ? p.b.z : p.a.z;
    float bottom = p.uv.x >= 0.5 ? p.d.z : p.c.z;
    return (p.uv.y >= 0.5 ? bottom : top) > 0.5;
}

// A step of Newton's method from a place in the real image, in nodes, toward the one that looks at an ideal place.
vec2 warp_step(GpuLens l, vec2 ideal_px, vec2 at_nodes) {
    Patch p = patch_at(l.first_texel, l.nodes, at_nodes);
    vec2 residual = ideal_px - bilinear(p);
    vec2 along_u = mix(p.b.xy - p.a.xy, p.d.xy - p.c.xy, p.uv.y);
    vec2 along_v = mix(p.c.xy - p.a.xy, p.d.xy - p.b.xy, p.uv.x);
    float area = along_u.x * along_v.y - along_u.y * along_v.x;
    vec2 way = vec2(residual.x * along_v.y - residual.y * along_v.x, along_u.x * residual.y - along_u.y * residual.x);
    return at_nodes + (area == 0.0 ? vec2(0.0) : clamp(way / area, vec2(-16.0), vec2(16.0)));
}

// From a real place to its ideal one; false where no light goes.
bool to_ideal(GpuLens l, inout vec2 at_px) {
    bool lit = true;
    if (l.kind == LENS_BROWN_CONRADY) {
        vec2 wanted = (at_px - l.centre_px) / l.focal_px;
        // As many steps as any lens that is taken needs, LENS_STEPS: without a loop, of which lavapipe makes few turns in all.
        vec2 at = shortened(wanted, l.reach);
        at = toward(l, wanted, toward(l, wanted, toward(l, wanted, at)));
        at = toward(l, wanted, toward(l, wanted, toward(l, wanted, at)));
        at = toward(l, wanted, toward(l, wanted, at));
        at_px = l.centre_px + l.focal_px * at;
    }
    if (l.kind == LENS_WARP) {
        Patch p = patch_at(l.first_texel, l.nodes, at_px * l.nodes_a_px - 0.5);
        at_px = bilinear(p);
        lit = is_lit(p);
    }
    return lit;
}

// From an ideal place to its real one, which may lie outside of the image; false where the lens does not show it.
bool to_real(GpuLens l, inout vec2 at_px) {
    bool shown = true;
    if (l.kind == LENS_BROWN_CONRADY) {
        vec2 at = (at_px - l.centre_px) / l.focal_px;
        vec3 slope;
        shown = length(at) <= l.reach;
        at_px = l.centre_px + l.focal_px * distorted(l, shortened(at, l.reach), slope);
    }
    if (l.kind == LENS_WARP) {
        Patch near = patch_at(l.inverse_first_texel, l.inverse_nodes, (at_px - l.inverse_low_px) / l.inverse_step_px);
        shown = all(lessThanEqual(abs(near.uv - 0.5), vec2(0.5))) && near.a.z + near.b.z + near.c.z + near.d.z > 0.5;
        vec2 at_nodes = (shown ? bilinear(near) : vec2(0.0)) * l.nodes_a_px - 0.5;
        at_nodes = warp_step(l, at_px, warp_step(l, at_px, at_nodes));
        at_nodes = warp_step(l, at_px, warp_step(l, at_px, at_nodes));
        Patch p = patch_at(l.first_texel, l.nodes, at_nodes);
        shown = shown && is_lit(p) && length(at_px - bilinear(p)) <= WARP_RESIDUAL_PX;
        at_px = (at_nodes + 0.5) / l.nodes_a_px;
    }
    return shown;
}

#endif
