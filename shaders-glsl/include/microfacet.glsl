// Fresnel's equations and the GGX lobe, as glTF 2.0 (appendix B) uses them.
#ifndef MICROFACET_GLSL
#define MICROFACET_GLSL

const float PI = 3.14159265358979;

// Below this perceptual roughness a lobe is a mirror: it is traced as one ray, and punctual lights do not show in it.
const float MIRROR_ROUGHNESS = 0.045;
// From here to 1 a dielectric's specular lobe fades out, so that a material of roughness 1 is purely diffuse and its look
// independent of the eye.
const float MATTE_FROM = 0.9;

// The share of unpolarised light that an interface reflects; eta = index behind / index in front. 1 at total internal reflection.
float fresnel_dielectric(float cos_i, float eta) {
    if (eta == 1.0) {
        return 0.0;
    }
    cos_i = clamp(abs(cos_i), 0.0, 1.0);
    float sin2_t = (1.0 - cos_i * cos_i) / (eta * eta);
    if (sin2_t >= 1.0) {
        return 1.0;
    }
    float cos_t = sqrt(1.0 - sin2_t);
    float parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    float perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    return 0.5 * (parallel * parallel + perpendicular * perpendicular);
}

// Schlick, Computer Graphics Forum 13(3), 1994.
vec3 fresnel_schlick(vec3 f0, float cos_i) {
    float m = clamp(1.0 - cos_i, 0.0, 1.0);
    float m2 = m * m;
    return f0 + (1.0 - f0) * (m2 * m2 * m);
}

// Normal distribution; alpha = roughness².
float ggx_d(float n_h, float alpha) {
    float a2 = alpha * alpha;
    float f = n_h * n_h * (a2 - 1.0) + 1.0;
    return a2 / (PI * f * f);
}

// Height-correlated Smith masking-shadowing over 4 (n·l)(n·v) (Heitz, JCGT 3(2), 2014).
float ggx_visibility(float n_l, float n_v, float alpha) {
    float a2 = alpha * alpha;
    float gv = n_l * sqrt(n_v * n_v * (1.0 - a2) + a2);
    float gl = n_v * sqrt(n_l * n_l * (1.0 - a2) + a2);
    return 0.5 / max(gv + gl, 1e-7);
}

float ggx_lambda(float n_x, float alpha) {
    float c2 = n_x * n_x;
    return 0.5 * (sqrt(1.0 + alpha * alpha * (1.0 - c2) / max(c2, 1e-7)) - 1.0);
}

// An orthonormal basis around n (Duff et al., JCGT 6(1), 2017).
void basis(vec3 n, out vec3 t, out vec3 b) {
    float s = n.z >= 0.0 ? 1.0 : -1.0;
    float a = -1.0 / (s + n.z);
    float c = n.x * n.y * a;
    t = vec3(1.0 + s * n.x * n.x * a, s * c, -s * n.x);
    b = vec3(c, s + n.y * n.y * a, -n.y);
}

// A visible microfacet normal around n, seen along v (Heitz, Sampling the GGX Distribution of Visible Normals, JCGT 7(4), 2018).
vec3 sample_visible_normal(vec3 n, vec3 v, float alpha, vec2 random) {
    vec3 t, b;
    basis(n, t, b);
    vec3 local = vec3(dot(v, t), dot(v, b), dot(v, n));
    vec3 stretched = normalize(vec3(alpha * local.x, alpha * local.y, local.z));
    float flat2 = stretched.x * stretched.x + stretched.y * stretched.y;
    vec3 t1 = flat2 > 0.0 ? vec3(-stretched.y, stretched.x, 0.0) * inversesqrt(flat2) : vec3(1.0, 0.0, 0.0);
    vec3 t2 = cross(stretched, t1);
    float r = sqrt(random.x);
    float phi = 2.0 * PI * random.y;
    float p1 = r * cos(phi);
    float p2 = r * sin(phi);
    float s = 0.5 * (1.0 + stretched.z);
    p2 = (1.0 - s) * sqrt(1.0 - p1 * p1) + s * p2;
    vec3 h = p1 * t1 + p2 * t2 + sqrt(max(0.0, 1.0 - p1 * p1 - p2 * p2)) * stretched;
    vec3 m = normalize(vec3(alpha * h.x, alpha * h.y, max(0.0, h.z)));
    return m.x * t + m.y * b + m.z * n;
}

#endif
