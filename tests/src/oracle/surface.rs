//! A hit, looked at: where it is, its normals, and what its material is there. Twin of `surface.glsl`.

use glam::{DVec2, DVec3, DVec4};
use lantern_scene::{Role, pack::NO_TEXTURE};

use super::{
    texture::texture_at,
    world::{Hit, World},
};

/// Everything about one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Metres.
    pub position_m: DVec3,
    /// Of the triangle; unit length.
    pub normal_geometric: DVec3,
    /// Interpolated and bent by the normal texture; unit length, on the geometric normal's side.
    pub normal: DVec3,
    /// Linear RGB.
    pub base: DVec3,
    /// Linear RGB radiance.
    pub emissive: DVec3,
    /// Per channel, inside the body.
    pub absorption_per_m: DVec3,
    /// 0 to 1.
    pub metallic: f64,
    /// Perceptual, 0 to 1.
    pub roughness: f64,
    /// 0 to 1.
    pub transmission: f64,
    /// Above 0: a closed body; 0: a thin sheet.
    pub thickness: f64,
    /// Index of refraction.
    pub ior: f64,
    /// 0 to 1.
    pub clearcoat: f64,
    /// Perceptual, 0 to 1.
    pub clearcoat_roughness: f64,
    /// Scale of the dielectric reflectance, 0 to 1.
    pub specular: f64,
    /// The instance's.
    pub role: Role,
}

impl Surface {
    /// A white diffuse point at the origin, facing +Z; for tests to vary.
    pub fn white() -> Self {
        Self {
            position_m: DVec3::ZERO,
            normal_geometric: DVec3::Z,
            normal: DVec3::Z,
            base: DVec3::ONE,
            emissive: DVec3::ZERO,
            absorption_per_m: DVec3::ZERO,
            metallic: 0.0,
            roughness: 1.0,
            transmission: 0.0,
            thickness: 0.0,
            ior: 1.5,
            clearcoat: 0.0,
            clearcoat_roughness: 0.0,
            specular: 1.0,
            role: Role::Prop,
        }
    }

    /// Looks at a hit. Normals point outward: to the triangle's front, whose winding a mirroring transform does not turn.
    pub fn at(world: &World, hit: &Hit) -> Self {
        let scene = world.scene();
        let instance = &scene.instances[hit.instance];
        let mesh = &scene.meshes[instance.mesh];
        let normal_from_object = instance.world_from_object.matrix3.inverse().transpose();
        let mirror = instance.world_from_object.matrix3.determinant().signum();

        // Geometry in the world.
        let [a, b, c] = world.corners_m(hit);
        let position_m = a * hit.weights.x + b * hit.weights.y + c * hit.weights.z;
        let normal_geometric = (b - a).cross(c - a).normalize_or_zero() * mirror;

        // Interpolated attributes.
        let vertices = mesh.indices[hit.triangle].map(|vertex| vertex as usize);
        let uvs = vertices.map(|vertex| {
            let [u, v] = mesh.uvs[vertex].map(f64::from);
            DVec2::new(u, v)
        });
        let weights = hit.weights.to_array();
        let uv: DVec2 = uvs.iter().zip(weights).map(|(uv, weight)| *uv * weight).sum();
        let smooth: DVec3 = vertices
            .iter()
            .zip(weights)
            .map(|(vertex, weight)| DVec3::from(mesh.normals[*vertex].map(f64::from)) * weight)
            .sum();
        let mut normal = (normal_from_object * smooth).normalize_or(normal_geometric);

        // The material's factors, times its textures.
        let gpu = &scene.gpu_materials[(instance.material_base + mesh.materials[hit.triangle]) as usize];
        let texel = |index: u32| {
            if index == NO_TEXTURE { DVec4::ONE } else { texture_at(&scene.textures, index, uv) }
        };
        let rough_metal = texel(gpu.metallic_roughness_texture);
        let [r, g, b_, _] = gpu.base_color.map(f64::from);

        if gpu.normal_texture != NO_TEXTURE {
            let bump = texel(gpu.normal_texture).truncate() * 2.0 - 1.0;
            let scale = f64::from(gpu.normal_scale);
            normal = bent(normal, [a, b, c], uvs, DVec3::new(bump.x * scale, bump.y * scale, bump.z));
        }
        if normal.dot(normal_geometric) < 0.0 {
            normal = -normal;
        }

        Self {
            position_m,
            normal_geometric,
            normal,
            base: DVec3::new(r, g, b_) * texel(gpu.base_color_texture).truncate(),
            emissive: DVec3::from(gpu.emissive.map(f64::from)) * texel(gpu.emissive_texture).truncate(),
            absorption_per_m: DVec3::from(gpu.absorption_per_m.map(f64::from)),
            metallic: f64::from(gpu.metallic) * rough_metal.z,
            roughness: f64::from(gpu.roughness) * rough_metal.y,
            transmission: gpu.transmission.into(),
            thickness: gpu.thickness.into(),
            ior: gpu.ior.into(),
            clearcoat: gpu.clearcoat.into(),
            clearcoat_roughness: gpu.clearcoat_roughness.into(),
            specular: gpu.specular.into(),
            role: instance.role,
        }
    }

    /// Turns both normals against a ray that arrives along `direction`. True where that ray was inside a closed body.
    #[must_use]
    pub fn turn_to(&mut self, direction: DVec3) -> bool {
        if self.normal_geometric.dot(direction) <= 0.0 {
            return false;
        }
        self.normal_geometric = -self.normal_geometric;
        self.normal = -self.normal;
        self.transmission > 0.0 && self.thickness > 0.0
    }
}

/// The normal that a normal texture asks for (glTF 2.0, section 3.9.3): +X along growing u, +Y up in the picture, which is
/// along falling v. The frame is the triangle's own, from its texture coordinates; where those have no area, the normal stays.
fn bent(n: DVec3, [a, b, c]: [DVec3; 3], uvs: [DVec2; 3], bump: DVec3) -> DVec3 {
    let (e1, e2) = (b - a, c - a);
    let (d1, d2) = (uvs[1] - uvs[0], uvs[2] - uvs[0]);
    let area = d1.perp_dot(d2);
    if area == 0.0 {
        return n;
    }
    let along_u = (e1 * d2.y - e2 * d1.y) / area;
    let along_v = (e2 * d1.x - e1 * d2.x) / area;
    let Some(tangent) = along_u.reject_from_normalized(n).try_normalize() else { return n };
    let side = n.cross(tangent);
    let upward = if side.dot(along_v) > 0.0 { -side } else { side };
    (tangent * bump.x + upward * bump.y + n * bump.z.max(1e-3)).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_normal_texture_bends_along_its_picture() {
        // u runs along +X; the picture's up is +Y, so v falls along it.
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let uvs = [DVec2::new(0.0, 1.0), DVec2::new(1.0, 1.0), DVec2::new(0.0, 0.0)];
        let flat = bent(DVec3::Z, corners, uvs, DVec3::Z);
        assert!((flat - DVec3::Z).length() < 1e-12);
        let tilted = bent(DVec3::Z, corners, uvs, DVec3::new(0.6, 0.0, 0.8));
        assert!((tilted - DVec3::new(0.6, 0.0, 0.8)).length() < 1e-12);
        let upward = bent(DVec3::Z, corners, uvs, DVec3::new(0.0, 0.6, 0.8));
        assert!((upward - DVec3::new(0.0, 0.6, 0.8)).length() < 1e-12);

        // Mirrored texture coordinates turn the one direction and not the other.
        let mirrored = uvs.map(|uv| DVec2::new(-uv.x, uv.y));
        let tilted = bent(DVec3::Z, corners, mirrored, DVec3::new(0.6, 0.0, 0.8));
        assert!((tilted - DVec3::new(-0.6, 0.0, 0.8)).length() < 1e-12);
        let upward = bent(DVec3::Z, corners, mirrored, DVec3::new(0.0, 0.6, 0.8));
        assert!((upward - DVec3::new(0.0, 0.6, 0.8)).length() < 1e-12);
        assert_eq!(bent(DVec3::Z, corners, [DVec2::ZERO; 3], DVec3::X), DVec3::Z);
    }

    #[test]
    fn turning_tells_inside_from_outside() {
        let mut glass = Surface { transmission: 1.0, thickness: 1.0, ..Surface::white() };
        assert!(!glass.turn_to(DVec3::NEG_Z));
        assert!(glass.turn_to(DVec3::Z));
        assert_eq!(glass.normal, DVec3::NEG_Z);
        let mut sheet = Surface { transmission: 1.0, ..Surface::white() };
        assert!(!sheet.turn_to(DVec3::Z), "a thin sheet has no inside");
    }
}
