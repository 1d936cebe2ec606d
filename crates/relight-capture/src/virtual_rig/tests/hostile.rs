//! Bad input gives errors that say what is wrong.

use glam::{DVec3, dvec2, dvec3};
use relight_scene::Pose;

use super::super::{
    Lamp, Material, Mesh, Model, PrintedBoard, Raster, RigError, Sensor, Settings, Stage, VirtualRig, shapes,
};
use super::{camera, floor, light, rig, settings, white_lamp};

fn fault_of(mesh: Mesh) -> String {
    let mut model = floor(1.0, Material::matt([0.5; 3]));
    model.push(mesh, Material::matt([0.5; 3]));
    let made = VirtualRig::new(&model, Lamp::default(), Sensor::default(), Settings::default());
    made.err().expect("an error").to_string()
}

#[test]
fn damaged_meshes_are_refused() {
    let good = shapes::sphere(0.1, 8);
    let damaged = |damage: fn(&mut Mesh)| {
        let mut mesh = good.clone();
        damage(&mut mesh);
        fault_of(mesh)
    };
    assert!(damaged(|m| m.triangles[0][1] = 1_000_000).contains("1000000"));
    assert!(damaged(|m| m.positions[3].x = f64::NAN).contains("no number"));
    assert!(damaged(|m| m.positions[3].x = f64::INFINITY).contains("100 m"));
    assert!(damaged(|m| m.positions[3].x = 1e9).contains("100 m"));
    assert!(damaged(|m| m.normals.truncate(2)).contains("2 normals"));
    assert!(damaged(|m| m.normals[1].x = f64::NAN).contains("not a finite number"));
    assert!(damaged(|m| m.uvs[1] = dvec2(f64::INFINITY, 0.0)).contains("not a finite number"));
}

#[test]
fn models_without_area_are_refused() {
    let nothing = VirtualRig::new(&Model::default(), Lamp::default(), Sensor::default(), Settings::default());
    assert!(matches!(nothing, Err(RigError::NoTriangles)));
    let mut model = Model::default();
    model.push(Mesh::flat(vec![DVec3::ZERO; 3], vec![[0, 1, 2]]), Material::matt([0.5; 3]));
    let empty = VirtualRig::new(&model, Lamp::default(), Sensor::default(), Settings::default());
    assert!(matches!(empty, Err(RigError::NoTriangles)));
}

#[test]
fn numbers_out_of_range_are_refused_by_name() {
    let made = |material: Material, lamp: Lamp, sensor: Sensor, settings: Settings| {
        VirtualRig::new(&floor(1.0, material), lamp, sensor, settings).err().expect("an error").to_string()
    };
    let matt = || Material::matt([0.5; 3]);
    let (lamp, sensor, settings) = (Lamp::default(), Sensor::default(), Settings::default());
    assert!(made(Material::metal([0.5; 3], 0.0), lamp, sensor, settings).contains("alpha"));
    assert!(made(Material::metal([0.5; 3], f64::NAN), lamp, sensor, settings).contains("alpha"));
    let mirror = Material::Glossy { reflectance: [0.5; 3].into(), alpha: 0.2, ior: 0.9 };
    assert!(made(mirror, lamp, sensor, settings).contains("refraction"));
    assert!(made(matt(), Lamp { radius: -1.0, ..lamp }, sensor, settings).contains("radius"));
    assert!(made(matt(), lamp, Sensor { exposure: f64::NAN, ..sensor }, settings).contains("exposure"));
    assert!(made(matt(), lamp, Sensor { full_well: 0.0, ..sensor }, settings).contains("full well"));
    assert!(made(matt(), lamp, sensor, Settings { samples: 0, ..settings }).contains("samples"));
    assert!(made(matt(), lamp, sensor, Settings { bounce_share: 0, ..settings }).contains("share"));
    assert!(Stage { wall_x: f64::NAN, ..Stage::default() }.model().is_err());
    assert!(Raster::linear(2, 2, vec![[0.0; 3]; 3]).is_err());
    assert!(Raster::linear(0, 0, Vec::new()).is_err());
    let board = PrintedBoard {
        columns: 3,
        rows: 3,
        picture: &[0; 8],
        texel: 0.01,
        pose: Pose::IDENTITY,
        reflectance: [0.1, 0.9],
    };
    assert!(board.model().unwrap_err().to_string().contains("3x3"));
}

#[test]
fn odd_views_give_pictures_all_the_same() {
    let rig = rig(&floor(1.0, Material::plastic([0.5; 3], 0.3)), white_lamp(0.005), settings(2));
    let view = camera(dvec3(0.3, 0.0, 0.3), DVec3::ZERO, [4, 3], 4.0);
    assert!(rig.photograph(&view, &[]).is_empty());
    // A light in the floor, one under it, one where the camera looks, and a camera within the floor.
    for place in [DVec3::ZERO, dvec3(0.0, 0.0, -0.5), dvec3(0.0, 0.0, 1e-9), dvec3(1e5, 0.0, 1e5)] {
        let pixels = &rig.radiance(&view, &[light(0, place)])[0].pixels;
        assert!(pixels.iter().flatten().all(|v| v.is_finite() && *v >= 0.0), "{place}: {pixels:?}");
    }
    let inside = camera(DVec3::ZERO, dvec3(1.0, 0.0, 0.0), [4, 3], 4.0);
    assert!(rig.radiance(&inside, &[light(0, DVec3::Z)])[0].pixels.iter().flatten().all(|v| v.is_finite()));
    let mut wild = view;
    wild.intrinsics.fx = f64::NAN;
    assert!(rig.radiance(&wild, &[light(0, DVec3::Z)])[0].pixels.iter().flatten().all(|v| *v == 0.0));
}
