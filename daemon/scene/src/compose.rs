//! Puts a scene together: nodes and their assets become the sections that the GPU reads, and a section that comes out as
//! it was stays the same `Arc`.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3, Vec3A};
use lantern_proto::Role;
use obvhs::aabb::Aabb;

use crate::asset::Asset;
use crate::bvh::Bvh;
use crate::edit::MAX_DISTANCE_M;
use crate::mesh::Mesh;
use crate::pack::{
    GpuInstance, GpuMaterial, GpuTop, INSTANCE_OPAQUE, NO_TEXTURE, ROLE_MASK, ROLE_PROP, ROLE_RASTER, ROLE_VIRTUAL,
};
use crate::scene::{Instance, Node, Parts, PlacedAsset, Scene, Shape, world_bounds};
use crate::texture;
use crate::top::Top;

/// How far the scene's middle may lie from the origin that GPU positions are relative to, before that origin moves.
const ORIGIN_REACH_M: f64 = 1000.0;

/// A scene that cannot be put together.
#[derive(Debug, thiserror::Error, PartialEq)]
pub(crate) enum ComposeError {
    #[error(
        "node {node:?} is placed, scaled or squeezed beyond what can be computed with; hint: check its transform and those inside its file"
    )]
    Transform { node: String },
}

impl ComposeError {
    pub(crate) fn code(&self) -> &'static str {
        "bad-transform"
    }
}

/// Brings every derived section of `draft` up to date with its nodes and lights. The draft comes as a clone of the
/// revision before, changed; sections whose input did not change keep their `Arc`.
pub(crate) fn compose(draft: &mut Scene) -> Result<(), ComposeError> {
    let assets = assets_in_use(&draft.nodes);
    let shapes = || draft.nodes.iter().flat_map(|node| node.shapes.values());

    // Meshes depend on which assets are in use and which shapes nodes have of their own, textures on the assets alone.
    let same_shapes = shapes().map(Arc::as_ptr).eq(draft.parts.shapes.iter().map(Arc::as_ptr));
    let same = assets.len() == draft.parts.assets.len()
        && assets.iter().zip(&draft.parts.assets).all(|(new, old)| Arc::ptr_eq(new, &old.asset));
    if !same || !same_shapes {
        (draft.parts, draft.meshes) = list_meshes(&assets, shapes().cloned().collect());
    }
    if !same {
        let textures = texture::pack(assets.iter().flat_map(|asset| &asset.textures));
        if !textures.same_as(&draft.textures) {
            draft.textures = Arc::new(textures);
        }
    }

    compose_materials(draft);
    compose_instances(draft)?;
    compose_placed(draft)
}

/// As [`compose`], where nothing but translations, rotations and scales of nodes has changed.
pub(crate) fn compose_placement(draft: &mut Scene) -> Result<(), ComposeError> {
    let mut instances = draft.instances.iter_mut();
    for node in &draft.nodes {
        let world_from_asset = node.world_from_asset();
        for (part, instance) in node.asset.parts.iter().zip(&mut instances) {
            instance.world_from_object = sound(node, world_from_asset * part.asset_from_object)?;
        }
    }
    compose_placed(draft)
}

/// What follows from where the instances are.
fn compose_placed(draft: &mut Scene) -> Result<(), ComposeError> {
    let boxes = world_boxes(draft)?;
    draft.origin_m = origin(draft.origin_m, &boxes);
    compose_top(draft, &boxes)?;
    compose_lights(draft);
    Ok(())
}

/// Keeps an `Arc` whose content stays equal.
fn renew<T: PartialEq>(section: &mut Arc<T>, content: T) {
    if **section != content {
        *section = Arc::new(content);
    }
}

fn assets_in_use(nodes: &[Node]) -> Vec<Arc<Asset>> {
    let mut assets: Vec<Arc<Asset>> = vec![];
    for node in nodes {
        if !assets.iter().any(|asset| Arc::ptr_eq(asset, &node.asset)) {
            assets.push(node.asset.clone());
        }
    }
    assets
}

/// The meshes of all assets, and after them the shapes.
fn list_meshes(assets: &[Arc<Asset>], shapes: Vec<Arc<Shape>>) -> (Parts, Vec<Arc<Mesh>>) {
    let mut parts = Parts::default();
    let mut meshes: Vec<Arc<Mesh>> = vec![];
    let mut first_texture = 0;
    for asset in assets {
        parts.assets.push(PlacedAsset { asset: asset.clone(), first_mesh: meshes.len(), first_texture });
        first_texture += asset.textures.len() as u32;
        meshes.extend_from_slice(&asset.meshes);
    }
    parts.first_shape = meshes.len();
    meshes.extend(shapes.iter().map(|shape| shape.mesh.clone()));
    parts.shapes = shapes;
    (parts, meshes)
}

/// Every node's materials, one after the other, with the scene's texture numbers.
fn compose_materials(draft: &mut Scene) {
    let mut materials = vec![];
    for node in &draft.nodes {
        let placed = draft.parts.assets.iter().find(|placed| Arc::ptr_eq(&placed.asset, &node.asset));
        let first_texture = placed.map_or(0, |placed| placed.first_texture);
        materials.extend(node.materials.iter().cloned().map(|mut material| {
            let gpu = &mut material.gpu;
            for texture in [
                &mut gpu.base_color_texture,
                &mut gpu.metallic_roughness_texture,
                &mut gpu.emissive_texture,
                &mut gpu.normal_texture,
            ] {
                if *texture != NO_TEXTURE {
                    *texture += first_texture;
                }
            }
            material
        }));
    }
    let gpu_materials: Vec<GpuMaterial> = materials.iter().map(|material| material.gpu).collect();
    renew(&mut draft.materials, materials);
    renew(&mut draft.gpu_materials, gpu_materials);
}

fn compose_instances(draft: &mut Scene) -> Result<(), ComposeError> {
    let mut instances = vec![];
    let (mut material_base, mut first_shape) = (0, draft.parts.first_shape);
    for (index, node) in draft.nodes.iter().enumerate() {
        let placed = draft.parts.assets.iter().find(|placed| Arc::ptr_eq(&placed.asset, &node.asset));
        let first_mesh = placed.map_or(0, |placed| placed.first_mesh);
        let world_from_asset = node.world_from_asset();
        for part in &node.asset.parts {
            let world_from_object = sound(node, world_from_asset * part.asset_from_object)?;
            let shape = node.shapes.keys().position(|&mesh| mesh == part.mesh);
            instances.push(Instance {
                node: index,
                mesh: shape.map_or(first_mesh + part.mesh, |number| first_shape + number),
                role: part.role.filter(|_| !node.role_is_said).unwrap_or(node.role),
                visible: node.visible,
                world_from_object,
                material_base,
            });
        }
        material_base += node.materials.len() as u32;
        first_shape += node.shapes.len();
    }
    draft.instances = instances;
    Ok(())
}

/// A part's placement, if it can be computed with.
fn sound(node: &Node, world_from_object: DAffine3) -> Result<DAffine3, ComposeError> {
    if is_sound(&world_from_object.matrix3) {
        return Ok(world_from_object);
    }
    Err(ComposeError::Transform { node: node.name.clone() })
}

/// Whether the f32 form of a matrix and of its inverse can be computed with: finite, and no axis lost against another.
pub(crate) fn is_sound(matrix: &DMat3) -> bool {
    let inverse = matrix.inverse();
    let largest = |m: &DMat3| {
        m.to_cols_array().iter().fold(0.0, |a: f64, b| if b.is_finite() { a.max(b.abs()) } else { f64::INFINITY })
    };
    let (size, inverse_size) = (largest(matrix), largest(&inverse));
    matrix.determinant() != 0.0 && size < 1e12 && inverse_size < 1e15 && size * inverse_size < 1e12
}

/// The box of every instance in the world, in f64; `None` for an empty mesh.
fn world_boxes(draft: &Scene) -> Result<Vec<Option<(DVec3, DVec3)>>, ComposeError> {
    let boxes = draft.instances.iter().map(|instance| {
        let Some(bounds_m) = draft.meshes[instance.mesh].bounds_m else { return Ok(None) };
        let (min, max) = world_bounds(bounds_m, &instance.world_from_object);
        let inside = min.cmpge(DVec3::splat(-10.0 * MAX_DISTANCE_M)) & max.cmple(DVec3::splat(10.0 * MAX_DISTANCE_M));
        if inside.all() {
            return Ok(Some((min, max)));
        }
        Err(ComposeError::Transform { node: draft.nodes[instance.node].name.clone() })
    });
    boxes.collect()
}

/// The origin stays while the scene's middle is within reach of it, so that a moving node does not shift the world; else
/// it goes to 0 if that is within reach, or to the whole metre next to the middle.
fn origin(current_m: DVec3, boxes: &[Option<(DVec3, DVec3)>]) -> DVec3 {
    let total = boxes.iter().flatten().copied().reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
    let Some((min, max)) = total else { return current_m };
    let middle = (min + max) * 0.5;
    if middle.length() <= ORIGIN_REACH_M {
        DVec3::ZERO
    } else if current_m != DVec3::ZERO && (middle - current_m).length() <= ORIGIN_REACH_M {
        current_m
    } else {
        middle.round()
    }
}

fn compose_top(draft: &mut Scene, boxes: &[Option<(DVec3, DVec3)>]) -> Result<(), ComposeError> {
    let origin_m = draft.origin_m;
    let mut gpu = Vec::with_capacity(draft.instances.len());
    for instance in &draft.instances {
        gpu.push(gpu_instance(draft, instance));
    }

    // The structure holds what rays can meet.
    let traced = draft.instances.iter().zip(boxes).enumerate();
    let traced: Vec<(u32, Aabb)> = traced
        .filter(|(_, (instance, _))| instance.is_traced())
        .filter_map(|(index, (_, bounds))| {
            bounds.map(|(min, max)| (index as u32, outward(min - origin_m, max - origin_m)))
        })
        .collect();
    let unchanged = draft.top.instances == gpu
        && draft.top_walk.boxes.iter().eq(traced.iter().map(|(_, b)| b))
        && draft.top_walk.instances.iter().eq(traced.iter().map(|(index, _)| index));
    if unchanged {
        return Ok(());
    }
    let (instances, boxes): (Vec<u32>, Vec<Aabb>) = traced.into_iter().unzip();
    let bvh = Bvh::build_top(&boxes);
    let order = bvh.order.iter().map(|&number| instances[number as usize]).collect();
    draft.top = Arc::new(GpuTop { instances: gpu, nodes: bvh.packed().to_vec(), order });
    draft.top_walk = Arc::new(Top { bvh, boxes, instances });
    Ok(())
}

/// The smallest f32 box around an f64 box.
fn outward(min: DVec3, max: DVec3) -> Aabb {
    let down = |x: f64| if f64::from(x as f32) > x { (x as f32).next_down() } else { x as f32 };
    let up = |x: f64| if f64::from(x as f32) < x { (x as f32).next_up() } else { x as f32 };
    Aabb::new(Vec3A::from_array(min.to_array().map(down)), Vec3A::from_array(max.to_array().map(up)))
}

fn gpu_instance(draft: &Scene, instance: &Instance) -> GpuInstance {
    let mut relative = instance.world_from_object;
    relative.translation -= draft.origin_m;
    let mesh = &draft.meshes[instance.mesh];
    let material = |number: &u32| &draft.materials[(instance.material_base + number) as usize];
    let opaque = mesh.used_materials.iter().all(|number| material(number).is_opaque());
    let role = match instance.role {
        Role::Prop => ROLE_PROP,
        Role::Virtual => ROLE_VIRTUAL,
        Role::Raster => ROLE_RASTER,
        Role::Mask => ROLE_MASK,
    };
    GpuInstance {
        world_from_object: rows(&relative),
        object_from_world: rows(&relative.inverse()),
        node_base: 0,
        triangle_base: 0,
        vertex_base: 0,
        scene_node: instance.node as u32,
        flags: role | if opaque { INSTANCE_OPAQUE } else { 0 },
        material_base: instance.material_base,
        triangle_count: mesh.indices.len() as u32,
        pad: 0,
    }
}

fn rows(affine: &DAffine3) -> [[f32; 4]; 3] {
    let (m, t) = (affine.matrix3, affine.translation);
    [0, 1, 2].map(|row| m.row(row).extend(t[row]).as_vec4().to_array())
}

fn compose_lights(draft: &mut Scene) {
    let mut lights = vec![];
    for node in &draft.nodes {
        let world_from_asset = node.world_from_asset();
        for (light, state) in node.asset.lights.iter().zip(&node.lights) {
            lights.extend(state.resolve(Some((light, world_from_asset)), draft.origin_m));
        }
    }
    lights.extend(draft.own_lights.iter().filter_map(|(_, state)| state.resolve(None, draft.origin_m)));
    renew(&mut draft.lights, lights);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_f32_box_holds_the_f64_box(a in prop::array::uniform3(-1e8f64..1e8), d in prop::array::uniform3(0f64..10.0)) {
            let (min, max) = (DVec3::from(a), DVec3::from(a) + DVec3::from(d));
            let b = outward(min, max);
            prop_assert!(b.min.as_dvec3().cmple(min).all() && b.max.as_dvec3().cmpge(max).all());
        }
    }

    #[test]
    fn the_origin_moves_only_when_the_scene_is_out_of_reach() {
        let at = |x: f64| [Some((DVec3::new(x - 1.0, 0.0, 0.0), DVec3::new(x + 1.0, 0.0, 0.0)))];
        assert_eq!(origin(DVec3::ZERO, &at(999.0)), DVec3::ZERO);
        let far = origin(DVec3::ZERO, &at(5000.3));
        assert_eq!(far, DVec3::new(5000.0, 0.0, 0.0));
        assert_eq!(origin(far, &at(5500.0)), far);
        assert_eq!(origin(far, &at(3.0)), DVec3::ZERO);
        assert_eq!(origin(far, &[None]), far);
    }
}
