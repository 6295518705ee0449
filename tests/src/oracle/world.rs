//! The scene as one heap of world-space triangles.

use glam::DVec3;
use lantern_scene::{Role, Scene};

use super::{
    bvh::Bvh,
    geometry::{Ray, Tri},
};

/// Which instances a ray can meet (CONTRACT, Roles).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meets {
    /// Props and masks: what a projector's light lands on.
    Physical,
    /// Virtual things alone: what may stand in the line of sight.
    Virtual,
    /// Props, masks and virtual things: what secondary rays see.
    Everything,
}

impl Meets {
    fn holds(self, role: Role) -> bool {
        match role {
            Role::Prop | Role::Mask => self != Self::Virtual,
            Role::Virtual => self != Self::Physical,
            Role::Raster => false,
        }
    }
}

/// The closest thing that a ray met.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray, m.
    pub t_m: f64,
    /// Weights of the triangle's corners.
    pub weights: DVec3,
    /// Index into the scene's instances.
    pub instance: usize,
    /// The mesh's own number.
    pub triangle: usize,
    corners_m: [DVec3; 3],
}

/// A revision of the scene, ready to be traced.
#[derive(Debug)]
pub struct World<'a> {
    scene: &'a Scene,
    bvh: Bvh,
    has_virtual: bool,
}

impl<'a> World<'a> {
    /// Places every visible instance's triangles.
    pub fn new(scene: &'a Scene) -> Self {
        let mut triangles = Vec::new();
        for (index, instance) in scene.instances.iter().enumerate() {
            if !instance.visible || instance.role == Role::Raster {
                continue;
            }
            let mesh = &scene.meshes[instance.mesh];
            triangles.extend(mesh.indices.iter().enumerate().map(|(triangle, vertices)| Tri {
                corners_m: vertices.map(|vertex| {
                    let corner = DVec3::from(mesh.positions[vertex as usize].map(f64::from));
                    instance.world_from_object.transform_point3(corner)
                }),
                instance: index as u32,
                triangle: triangle as u32,
            }));
        }
        let has_virtual = scene.instances.iter().any(|instance| instance.visible && instance.role == Role::Virtual);
        Self { scene, bvh: Bvh::new(triangles), has_virtual }
    }

    /// What it was made from.
    pub fn scene(&self) -> &Scene {
        self.scene
    }

    /// Whether anything visible is virtual.
    pub fn has_virtual(&self) -> bool {
        self.has_virtual
    }

    /// The closest hit within the ray's reach.
    pub fn closest(&self, ray: &Ray, meets: Meets) -> Option<Hit> {
        let (tri, meeting) = self.bvh.closest(ray, |tri| meets.holds(self.role(tri)))?;
        Some(Hit::of(&tri, meeting.t_m, meeting.weights))
    }

    /// Every hit of anything within the ray's reach, in no order, until `each` returns false.
    pub fn each(&self, ray: &Ray, mut each: impl FnMut(Hit) -> bool) {
        self.bvh.each(ray, |tri, meeting| each(Hit::of(tri, meeting.t_m, meeting.weights)));
    }

    /// The corners of the triangle of a hit.
    pub fn corners_m(&self, hit: &Hit) -> [DVec3; 3] {
        hit.corners_m
    }

    fn role(&self, tri: &Tri) -> Role {
        self.scene.instances[tri.instance as usize].role
    }
}

impl Hit {
    fn of(tri: &Tri, t_m: f64, weights: DVec3) -> Self {
        Self {
            t_m,
            weights,
            instance: tri.instance as usize,
            triangle: tri.triangle as usize,
            corners_m: tri.corners_m,
        }
    }
}
