//! One immutable revision of the scene.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};
use lantern_proto as proto;
use lantern_proto::{Edit, Role};

use crate::asset::Asset;
use crate::light::LightState;
use crate::material::{self, Material};
use crate::mesh::Mesh;
use crate::pack::{GpuEnvironment, GpuLight, GpuMaterial, GpuTop};
use crate::texture::GpuTextures;
use crate::top::Top;

/// One immutable revision. Cheap to clone; a section that an edit left alone is the same `Arc` as before.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Counts up with every change; an empty scene that nothing changed yet is 0.
    pub revision: u64,
    /// World positions on the GPU are relative to it; 0 unless the scene stands more than 1 km from the world's origin.
    pub origin_m: DVec3,
    /// In `scene.get` order: the index is the `node` layer's value.
    pub nodes: Vec<Node>,
    /// Triangles and bottom-level structures; each mesh once, however often it is placed. See [`crate::MeshPart`] for what the
    /// GPU reads of them.
    pub meshes: Vec<Arc<Mesh>>,
    /// Every placed mesh; same order and length as `top.instances`.
    pub instances: Vec<Instance>,
    /// One after the other those of every node; a triangle's number plus its instance's base indexes them.
    pub materials: Arc<Vec<Material>>,
    /// Instances and the structure over them.
    pub top: Arc<GpuTop>,
    /// The values of [`Scene::materials`].
    pub gpu_materials: Arc<Vec<GpuMaterial>>,
    /// Every texture of every file in use.
    pub textures: Arc<GpuTextures>,
    /// Imported ones first, in the order of their nodes.
    pub lights: Arc<Vec<GpuLight>>,
    /// What a miss sees.
    pub environment: Arc<GpuEnvironment>,
    pub(crate) environment_source: EnvironmentSource,
    pub(crate) own_lights: Vec<(String, LightState)>,
    pub(crate) parts: Parts,
    pub(crate) top_walk: Arc<Top>,
}

/// What [`Scene::meshes`] and [`Scene::textures`] were put together from.
#[derive(Clone, Debug, Default)]
pub(crate) struct Parts {
    /// Each asset in use once, in the order of first use, with the number of its first mesh and texture.
    pub(crate) assets: Vec<PlacedAsset>,
    /// Every node's own shapes, in order: their meshes come after those of all assets.
    pub(crate) shapes: Vec<Arc<Shape>>,
    /// The number of the first of those.
    pub(crate) first_shape: usize,
}

#[derive(Clone, Debug)]
pub(crate) struct PlacedAsset {
    pub(crate) asset: Arc<Asset>,
    pub(crate) first_mesh: usize,
    pub(crate) first_texture: u32,
}

/// Where the environment comes from.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum EnvironmentSource {
    /// Linear RGB.
    Color([f64; 3]),
    /// As it was given.
    Uri(String),
}

/// A node as edits know it.
#[derive(Clone, Debug)]
pub struct Node {
    /// Unique in the scene.
    pub name: String,
    /// As the client gave it, or the canonical path of a file of the configuration.
    pub uri: String,
    /// The role that an edit gave it, of all its parts; prop where none did.
    pub role: Role,
    /// Whether an edit gave it; else the file's word on a part comes first.
    pub(crate) role_is_said: bool,
    /// Whether anything sees it.
    pub visible: bool,
    /// Metres.
    pub translation_m: DVec3,
    /// Unit length.
    pub rotation: DQuat,
    /// Factor an axis; a negative one mirrors.
    pub scale: DVec3,
    pub(crate) asset: Arc<Asset>,
    /// The asset's materials as edits left them; texture numbers are the asset's.
    pub(crate) materials: Arc<Vec<Material>>,
    /// What edits said of each of the asset's lights.
    pub(crate) lights: Vec<LightState>,
    /// The asset's meshes that it has in a shape of its own, by their numbers.
    pub(crate) shapes: BTreeMap<usize, Arc<Shape>>,
}

/// A mesh whose vertices an edit has moved.
#[derive(Debug)]
pub(crate) struct Shape {
    /// As the edit gave them: one for each of the file's vertices.
    pub(crate) positions_m: Vec<[f32; 3]>,
    pub(crate) mesh: Arc<Mesh>,
}

impl Node {
    /// From the file's frame to the world.
    pub fn world_from_asset(&self) -> DAffine3 {
        DAffine3::from_scale_rotation_translation(self.scale, self.rotation, self.translation_m)
    }

    /// What its file holds that Lantern ignores, in words.
    pub fn warnings(&self) -> &[String] {
        &self.asset.warnings
    }

    /// The names of its materials, in the file's order.
    pub fn material_names(&self) -> impl Iterator<Item = &str> {
        self.materials.iter().map(|material| material.name.as_str())
    }
}

/// One placed mesh.
///
/// A transform may mirror. As in glTF a triangle keeps its front side then, so its outward normal in the world is
/// transpose(object from world) × (e1 × e2), for every transform; the cross product of transformed edges would flip.
#[derive(Clone, Debug, PartialEq)]
pub struct Instance {
    /// Index into [`Scene::nodes`].
    pub node: usize,
    /// Index into [`Scene::meshes`].
    pub mesh: usize,
    /// What an edit said of the node, else the file of this part, else prop.
    pub role: Role,
    /// Its node's.
    pub visible: bool,
    /// In the world's own frame, not relative to the origin.
    pub world_from_object: DAffine3,
    /// Added to a triangle's material number.
    pub material_base: u32,
}

impl Instance {
    /// Whether rays of any kind can meet it.
    pub fn is_traced(&self) -> bool {
        self.visible && self.role != Role::Raster
    }
}

/// A visible instance's triangles, for whoever traces the scene by other means.
#[derive(Clone, Copy, Debug)]
pub struct WorldMesh<'a> {
    /// Of the instance.
    pub role: Role,
    /// Index of the node in `scene.get` order.
    pub node: usize,
    /// Index of the instance.
    pub instance: usize,
    /// In the world's own frame.
    pub world_from_object: DAffine3,
    /// Added to a triangle's material number.
    pub material_base: u32,
    /// In object space; see [`Mesh::corners`].
    pub mesh: &'a Mesh,
}

impl Scene {
    /// Triangles of all instances, drawn or not; a mesh counts as often as it is placed.
    pub fn triangle_count(&self) -> usize {
        self.instances.iter().map(|instance| self.meshes[instance.mesh].indices.len()).sum()
    }

    /// Bytes of all sections as the GPU holds them.
    pub fn device_bytes(&self) -> u64 {
        let meshes: u64 = self.meshes.iter().map(|mesh| mesh.device_bytes()).sum();
        let images = self.textures.images.iter().map(|image| size_of_val(image.texels.as_slice()));
        let bytes = images.sum::<usize>()
            + size_of_val(self.top.instances.as_slice())
            + size_of_val(self.top.nodes.as_slice())
            + size_of_val(self.top.order.as_slice())
            + size_of_val(self.gpu_materials.as_slice())
            + size_of_val(self.textures.headers.as_slice())
            + size_of_val(self.lights.as_slice())
            + size_of_val(self.environment.texels.as_slice())
            + size_of_val(&self.environment.irradiance);
        meshes + bytes as u64
    }

    /// The node of a name, with its index.
    pub fn node(&self, name: &str) -> Option<(usize, &Node)> {
        self.nodes.iter().enumerate().find(|(_, node)| node.name == name)
    }

    /// The names of all lights that shine, as edits call them: `node/light` for imported ones.
    pub fn light_names(&self) -> Vec<String> {
        let imported = self.nodes.iter().flat_map(|node| {
            let lights = node.asset.lights.iter().zip(&node.lights).filter(|(_, state)| !state.removed);
            lights.map(|(light, _)| format!("{}/{}", node.name, light.name))
        });
        imported.chain(self.own_lights.iter().map(|(name, _)| name.clone())).collect()
    }

    /// The corners of the box around a node's meshes in the world, m; `None` for one without triangles.
    pub fn bounds_of(&self, node: usize) -> Option<(DVec3, DVec3)> {
        let instances = self.instances.iter().filter(|instance| instance.node == node);
        let boxes = instances.filter_map(|instance| {
            world_bounds(self.meshes[instance.mesh].bounds_m?, &instance.world_from_object).into()
        });
        boxes.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    }

    /// Every visible instance, in order.
    pub fn world_meshes(&self) -> impl Iterator<Item = WorldMesh<'_>> {
        self.instances.iter().enumerate().filter(|(_, instance)| instance.visible).map(|(index, instance)| WorldMesh {
            role: instance.role,
            node: instance.node,
            instance: index,
            world_from_object: instance.world_from_object,
            material_base: instance.material_base,
            mesh: &self.meshes[instance.mesh],
        })
    }

    /// `scene.get`: the edits that rebuild this scene out of an empty one. All adds come first, so that the index of an
    /// add is the index of its node.
    pub fn edits(&self) -> Vec<Edit> {
        let mut edits: Vec<Edit> = self.nodes.iter().map(|node| Edit::Add(add_of(node))).collect();
        let hidden = self.nodes.iter().filter(|node| !node.visible);
        edits.extend(hidden.map(|node| {
            Edit::Set(proto::Set { node: node.name.clone(), visible: Some(false), ..proto::Set::default() })
        }));
        for node in &self.nodes {
            edits.extend(node.shapes.iter().map(|(&mesh, shape)| {
                let mesh = proto::MeshRef::Index(node.asset.vertices[mesh].mesh);
                let positions_m = shape.positions_m.clone();
                Edit::Vertices(proto::Vertices { node: node.name.clone(), mesh, positions_m })
            }));
        }
        for node in &self.nodes {
            for (of_file, now) in node.asset.materials.iter().zip(node.materials.iter()) {
                let name = format!("{}/{}", node.name, now.name);
                edits.extend(material::difference(name, &of_file.gpu, &now.gpu).map(Edit::Material));
            }
        }
        for node in &self.nodes {
            for (light, state) in node.asset.lights.iter().zip(&node.lights) {
                edits.extend(state.edit(format!("{}/{}", node.name, light.name)).map(Edit::Light));
            }
        }
        edits.extend(self.own_lights.iter().filter_map(|(name, state)| state.edit(name.clone()).map(Edit::Light)));
        edits.push(Edit::Environment(match &self.environment_source {
            EnvironmentSource::Color(color) => proto::Environment { uri: None, color: Some(proto::Color(*color)) },
            EnvironmentSource::Uri(uri) => proto::Environment { uri: Some(uri.clone()), color: None },
        }));
        edits
    }
}

/// The add of a node. What an absent field means is left out, so that the list stays readable.
fn add_of(node: &Node) -> proto::Add {
    proto::Add {
        node: node.name.clone(),
        uri: node.uri.clone(),
        role: node.role_is_said.then_some(node.role),
        translation_m: (node.translation_m != DVec3::ZERO).then(|| node.translation_m.into()),
        rotation: (node.rotation != DQuat::IDENTITY).then(|| node.rotation.to_array()),
        scale: (node.scale != DVec3::ONE).then(|| node.scale.into()),
    }
}

/// The box around a transformed box: the exact extreme of each axis, up to f64 rounding.
pub(crate) fn world_bounds((min, max): (DVec3, DVec3), world_from_object: &DAffine3) -> (DVec3, DVec3) {
    let centre = world_from_object.transform_point3((min + max) * 0.5);
    let half = (max - min) * 0.5;
    let matrix = world_from_object.matrix3;
    let reach = matrix.x_axis.abs() * half.x + matrix.y_axis.abs() * half.y + matrix.z_axis.abs() * half.z;
    (centre - reach, centre + reach)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_box_of_a_turned_box_touches_its_corners() {
        let placed = DAffine3::from_rotation_y(0.3) * DAffine3::from_scale(DVec3::new(1.0, -2.0, 3.0));
        let (min, max) = (DVec3::new(-1.0, 0.0, 2.0), DVec3::new(1.0, 1.0, 2.5));
        let corners: Vec<DVec3> = (0..8)
            .map(|i| DVec3::new([min.x, max.x][i & 1], [min.y, max.y][i >> 1 & 1], [min.z, max.z][i >> 2]))
            .map(|corner| placed.transform_point3(corner))
            .collect();
        let expected = corners.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), c| (a.min(*c), b.max(*c)));
        let found = world_bounds((min, max), &placed);
        assert!((found.0 - expected.0).length() < 1e-12 && (found.1 - expected.1).length() < 1e-12);
    }
}
