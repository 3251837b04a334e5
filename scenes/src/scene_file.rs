//! Scene files: `scene.toml` in a folder of the scene's name. `scenes/vase/scene.toml` documents every key.

use crate::camera::Camera;
use crate::environment::Environment;
use crate::error::{Error, Result};
use crate::exr_file;
use crate::geometry::{Geometry, Grain, Mesh};
use crate::material_file::load_material;
use crate::scene::{Scene, Surface};
use crate::studio::{self, Sky, Softbox};
use crate::toml_file;
use glam::{Vec2, Vec3};
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Largest width and height of a picture, where the arrays of an image take 0.9 GB.
const PIXELS_MAX: usize = 4096;

/// Longest paths: past this even white surfaces have let nearly all light go.
const DEPTH_MAX: usize = 64;

/// Largest number of sectors or steps of a surface of revolution: two million triangles a span.
const TESSELLATION_MAX: usize = 1024;

/// Reads the scene at `path`, a folder with `scene.toml` or that file itself; material names stand for
/// `../materials/NAME.toml` relative to the folder.
///
/// # Errors
/// [`Error::Io`], [`Error::Syntax`], [`Error::Key`], [`Error::Material`] or [`Error::ImageFile`], each naming
/// the file and, inside a TOML file, the key.
pub fn load_scene(path: &Path) -> Result<Scene> {
    let path = if path.is_dir() {
        path.join("scene.toml")
    } else {
        path.to_owned()
    };
    let file: SceneFile = toml_file::read(&path)?;
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    let reader = Reader { path, folder };
    let (mut mesh, mut surfaces) = (Mesh::default(), Vec::new());
    for (i, revolution) in file.revolution.iter().enumerate() {
        reader.add_revolution(revolution, &format!("revolution[{i}]"), &mut mesh, &mut surfaces)?;
    }
    for (i, ground) in file.ground.iter().enumerate() {
        reader.add_ground(ground, &format!("ground[{i}]"), &mut mesh, &mut surfaces)?;
    }
    if surfaces.is_empty() {
        return Err(Error::key(
            &reader.path,
            "revolution",
            "the scene has no objects; add a [[revolution]] or [[ground]]",
        ));
    }
    let picture = &file.picture;
    for (key, value, largest) in [
        ("picture.width", picture.width, PIXELS_MAX),
        ("picture.height", picture.height, PIXELS_MAX),
        ("picture.max_depth", picture.max_depth, DEPTH_MAX),
    ] {
        reader.require((1..=largest).contains(&value), key, || {
            format!("is {value}, but must lie in 1..{largest}")
        })?;
    }
    reader.finite(&[picture.exposure], "picture.exposure")?;
    Ok(Scene {
        name: reader.scene_name(),
        width: picture.width,
        height: picture.height,
        max_depth: picture.max_depth,
        exposure: picture.exposure,
        camera: reader.camera(&file.camera, picture.width as f32 / picture.height as f32)?,
        environment: reader.environment(&file.environment)?,
        geometry: Geometry::new(mesh),
        surfaces,
    })
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SceneFile {
    picture: PictureTable,
    camera: CameraTable,
    environment: EnvironmentTable,
    #[serde(default)]
    revolution: Vec<RevolutionTable>,
    #[serde(default)]
    ground: Vec<GroundTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PictureTable {
    width: usize,
    height: usize,
    #[serde(default = "default_max_depth")]
    max_depth: usize,
    #[serde(default)]
    exposure: f32,
}

/// Enough for light that enters a vase and leaves it again; a seventh reflection adds under 0.1 %.
fn default_max_depth() -> usize {
    6
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraTable {
    position: [f32; 3],
    target: [f32; 3],
    fov: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct EnvironmentTable {
    file: Option<PathBuf>,
    sky: Option<SkyTable>,
    #[serde(default)]
    softbox: Vec<SoftboxTable>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SkyTable {
    zenith: [f32; 3],
    horizon: [f32; 3],
    nadir: [f32; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SoftboxTable {
    azimuth: f64,
    elevation: f64,
    size: [f64; 2],
    softness: f64,
    radiance: [f32; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RevolutionTable {
    material: String,
    profile: Vec<[f32; 2]>,
    #[serde(default)]
    position: [f32; 3],
    grain: Grain,
    sectors: usize,
    steps: usize,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GroundTable {
    #[serde(default)]
    height: f32,
    radius: f32,
    albedo: [f32; 3],
}

/// The file being read, to resolve names in and to blame in errors.
struct Reader {
    path: PathBuf,
    folder: PathBuf,
}

impl Reader {
    fn scene_name(&self) -> String {
        let folder = self.folder.canonicalize().unwrap_or_else(|_| self.folder.clone());
        folder
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned()
    }

    fn require(&self, holds: bool, key: &str, reason: impl FnOnce() -> String) -> Result<()> {
        if holds {
            Ok(())
        } else {
            Err(Error::key(&self.path, key, reason()))
        }
    }

    fn finite(&self, values: &[f32], key: &str) -> Result<()> {
        self.require(values.iter().all(|v| v.is_finite()), key, || {
            "must be finite".into()
        })
    }

    /// Colours and radiances: finite and at least 0.
    fn rgb(&self, values: [f32; 3], key: &str) -> Result<Vec3> {
        let holds = values.iter().all(|v| v.is_finite() && *v >= 0.0);
        self.require(holds, key, || {
            format!("is {values:?}, but no channel may be negative, infinite or NaN")
        })?;
        Ok(Vec3::from(values))
    }

    fn camera(&self, table: &CameraTable, aspect: f32) -> Result<Camera> {
        self.finite(&table.position, "camera.position")?;
        self.finite(&table.target, "camera.target")?;
        let fov = table.fov;
        self.require(fov > 0.0 && fov < 180.0, "camera.fov", || {
            format!("is {fov}, but must lie between 0 and 180 degrees")
        })?;
        Camera::look_at(table.position.into(), table.target.into(), fov, aspect).ok_or_else(|| {
            let reason = "must differ from camera.position and not lie straight above or below it";
            Error::key(&self.path, "camera.target", reason)
        })
    }

    fn environment(&self, table: &EnvironmentTable) -> Result<Environment> {
        match (&table.file, &table.sky) {
            (Some(file), None) if table.softbox.is_empty() => {
                let file = self.folder.join(file);
                self.require(file.is_file(), "environment.file", || {
                    format!("there is no file {}", file.display())
                })?;
                exr_file::read_environment(&file)
            }
            (None, Some(sky)) => {
                let sky = Sky {
                    zenith: self.rgb(sky.zenith, "environment.sky.zenith")?,
                    horizon: self.rgb(sky.horizon, "environment.sky.horizon")?,
                    nadir: self.rgb(sky.nadir, "environment.sky.nadir")?,
                };
                let boxes: Result<Vec<Softbox>> = table
                    .softbox
                    .iter()
                    .enumerate()
                    .map(|(i, table)| self.softbox(i, table))
                    .collect();
                Ok(studio::rasterise(&sky, &boxes?))
            }
            _ => Err(Error::key(
                &self.path,
                "environment",
                "give either `file`, or `sky` and any number of `softbox`",
            )),
        }
    }

    fn softbox(&self, index: usize, table: &SoftboxTable) -> Result<Softbox> {
        let key = |name: &str| format!("environment.softbox[{index}].{name}");
        self.require(table.azimuth.is_finite(), &key("azimuth"), || {
            "must be finite".into()
        })?;
        self.require(table.elevation.abs() < 90.0, &key("elevation"), || {
            format!("is {}, but must lie between -90 and 90 degrees", table.elevation)
        })?;
        self.require(
            table.size.iter().all(|s| *s > 0.0 && *s <= 170.0),
            &key("size"),
            || {
                format!(
                    "is {:?}, but width and height must lie between 0 and 170 degrees",
                    table.size
                )
            },
        )?;
        self.require((0.0..=1.0).contains(&table.softness), &key("softness"), || {
            format!("is {}, but must lie in 0..1", table.softness)
        })?;
        Ok(Softbox {
            azimuth: table.azimuth,
            elevation: table.elevation,
            size: table.size,
            softness: table.softness,
            radiance: self.rgb(table.radiance, &key("radiance"))?,
        })
    }

    fn add_revolution(
        &self,
        table: &RevolutionTable,
        key: &str,
        mesh: &mut Mesh,
        surfaces: &mut Vec<Surface>,
    ) -> Result<()> {
        let points: Vec<Vec2> = table.profile.iter().map(|p| Vec2::from(*p)).collect();
        let differ = points.windows(2).any(|w| w[0] != w[1]);
        self.require(differ, &format!("{key}.profile"), || {
            "needs at least two different points".into()
        })?;
        for (i, p) in points.iter().enumerate() {
            self.require(
                p.is_finite() && p.x >= 0.0,
                &format!("{key}.profile[{i}]"),
                || {
                    format!(
                        "is [{}, {}], but must be a finite [radius, height] with radius at least 0",
                        p.x, p.y
                    )
                },
            )?;
        }
        self.finite(&table.position, &format!("{key}.position"))?;
        for (name, value, least) in [("sectors", table.sectors, 3), ("steps", table.steps, 1)] {
            self.require(
                (least..=TESSELLATION_MAX).contains(&value),
                &format!("{key}.{name}"),
                || format!("is {value}, but must lie in {least}..{TESSELLATION_MAX}"),
            )?;
        }
        let surface = self.material(&table.material, &format!("{key}.material"), surfaces)?;
        mesh.add_revolution(
            &points,
            table.position.into(),
            table.grain,
            [table.sectors, table.steps],
            surface,
        );
        Ok(())
    }

    fn add_ground(
        &self,
        table: &GroundTable,
        key: &str,
        mesh: &mut Mesh,
        surfaces: &mut Vec<Surface>,
    ) -> Result<()> {
        self.finite(&[table.height], &format!("{key}.height"))?;
        let radius = table.radius;
        self.require(
            radius.is_finite() && radius > 0.0,
            &format!("{key}.radius"),
            || format!("is {radius}, but must be positive and finite"),
        )?;
        let albedo = self.rgb(table.albedo, &format!("{key}.albedo"))?;
        self.require(albedo.max_element() <= 1.0, &format!("{key}.albedo"), || {
            format!("is {:?}, but a surface cannot reflect more than 1", table.albedo)
        })?;
        surfaces.push(Surface::Diffuse(albedo));
        mesh.add_disk(Vec3::Y * table.height, radius, surfaces.len() as u32 - 1);
        Ok(())
    }

    /// Index of the material called `name` in `surfaces`, loaded when it is new.
    fn material(&self, name: &str, key: &str, surfaces: &mut Vec<Surface>) -> Result<u32> {
        let known = |surface: &Surface| matches!(surface, Surface::Material(m) if m.name == name);
        if let Some(index) = surfaces.iter().position(known) {
            return Ok(index as u32);
        }
        let file = self.folder.join("../materials").join(format!("{name}.toml"));
        self.require(file.is_file(), key, || {
            format!("there is no material file {}", file.display())
        })?;
        surfaces.push(Surface::Material(load_material(&file)?));
        Ok(surfaces.len() as u32 - 1)
    }
}
