// Light that arrives at a point straight from its sources: KHR_lights_punctual with hard shadows, and the environment's irradiance.
#ifndef LIGHT_GLSL
#define LIGHT_GLSL

#include "surface.glsl"
#include "environment.glsl"

// The way to a light from p, the distance to it, and what it sends: lux at normal incidence, before any shadow.
vec3 light_at(GpuLight l, vec3 p, out vec3 to_light, out float distance_m) {
    if (l.kind == LIGHT_DIRECTIONAL) {
        to_light = -l.direction;
        distance_m = 3.0e38;
        return l.intensity;
    }
    vec3 way = l.position - p;
    float d2 = max(dot(way, way), 1e-8);
    distance_m = sqrt(d2);
    to_light = way / distance_m;
    vec3 lux = l.intensity / d2;
    if (l.range > 0.0) {
        float q = distance_m / l.range;
        float window = clamp(1.0 - q * q * q * q, 0.0, 1.0);
        lux *= window;
    }
    if (l.kind == LIGHT_SPOT) {
        float angular = clamp((dot(-to_light, l.direction) - l.cos_outer) / max(l.cos_inner - l.cos_outer, 1e-4), 0.0, 1.0);
        lux *= angular * angular;
    }
    return lux;
}

// What arrives from one light where nothing stands between, lux at normal incidence, and the ray that finds out; black from behind
// either normal. `origin`: the surface's, offset to the lit side.
vec3 unshadowed(GpuLight l, Surface s, vec3 origin, out Ray to_light) {
    float distance_m;
    to_light.origin = origin;
    to_light.t_min = 0.0;
    vec3 lux = light_at(l, s.position, to_light.direction, distance_m);
    to_light.t_max = l.kind == LIGHT_DIRECTIONAL ? 3.0e38 : length(l.position - origin);
    bool faces = dot(s.normal, to_light.direction) > 0.0 && dot(s.normal_geometric, to_light.direction) > 0.0;
    return faces ? lux : vec3(0.0);
}

// What is left of a light behind things that let it through, below which it counts as shadow.
const float MIN_TRANSMITTANCE = 1.0 / 1024.0;

// The share of light that arrives, by channel: 0 behind anything opaque, dimmed by each surface that lets light through, unbent.
vec3 trace_shadow(Ray ray) {
    ++shadow_rays_made;
    vec3 transmittance = vec3(1.0);
    while (true) {
        Hit hit;
        bool more = false;
        bool blocked = traverse(ray, EVERYTHING, SHADOW, hit);
        record_ray(RAY_SHADOW, ray, hit);
        if (blocked) {
            transmittance = vec3(0.0);
        } else if (TRANSMISSIVE != 0u && hit.instance != NO_INSTANCE) {
            transmittance *= shadow_crossing(surface_at(hit.instance, hit.triangle, hit.barycentric), ray.direction);
            ray.t_min = hit.t;
            more = max(transmittance.x, max(transmittance.y, transmittance.z)) > MIN_TRANSMITTANCE;
        }
        if (!more) {
            break;
        }
    }
    return transmittance;
}

// GGX highlight of one light, times n·l: radiance per lux.
vec3 highlight(vec3 n, vec3 v, vec3 l, float roughness, vec3 f) {
    if (roughness < MIRROR_ROUGHNESS) {
        return vec3(0.0);
    }
    vec3 h = normalize(v + l);
    float alpha = roughness * roughness;
    float n_l = max(dot(n, l), 0.0);
    float n_v = max(dot(n, v), 1e-4);
    return f * (ggx_d(max(dot(n, h), 0.0), alpha) * ggx_visibility(n_l, n_v, alpha) * n_l);
}

// Specular reflectance of the base layer at this cosine: exact for the dielectric part, Schlick's for the metal.
vec3 base_fresnel(Surface s, float cos_i, bool from_inside) {
    float eta = from_inside ? 1.0 / s.ior : s.ior;
    vec3 dielectric = vec3(fresnel_dielectric(cos_i, eta) * s.specular);
    return mix(dielectric, fresnel_schlick(s.base, cos_i), s.metallic) * specular_scale(s);
}

#endif
