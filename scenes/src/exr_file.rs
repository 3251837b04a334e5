//! OpenEXR files: images with all their data, and environment maps.

use crate::environment::Environment;
use crate::error::{Error, Result};
use crate::image::Image;
use bake_runtime::network::write_atomically;
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Layer, LayerAttributes, ReadChannels,
    ReadLayers, SmallVec, Text, WritableImage,
};
use glam::Vec3;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

/// Attribute that holds [`Image::spp`].
const SPP_KEY: &str = "bake.spp";

/// Attribute that holds [`Image::non_finite`].
const NON_FINITE_KEY: &str = "bake.non_finite";

type FlatLayer = Layer<AnyChannels<FlatSamples>>;

/// Writes every array of `image` in full precision: `R G B`, `variance.R G B`, `albedo.R G B`,
/// `normal.X Y Z` and `object`; counts and attributes as text attributes. Whole or not at all.
///
/// # Errors
/// [`Error::Runtime`] naming the file that could not be written.
pub fn write(path: &Path, image: &Image) -> Result<()> {
    let groups = [
        ("", RGB, &image.rgb),
        ("variance", RGB, &image.variance),
        ("albedo", RGB, &image.albedo),
        ("normal", XYZ, &image.normal),
    ];
    let mut channels = Channels::new();
    for (group, letters, pixels) in groups {
        push_triples(&mut channels, group, letters, pixels);
    }
    channels.push(AnyChannel::new("object", FlatSamples::F32(image.object.clone())));
    let mut attributes = image.attributes.clone();
    attributes.insert(SPP_KEY.into(), image.spp.to_string());
    attributes.insert(NON_FINITE_KEY.into(), image.non_finite.to_string());
    write_channels(path, [image.width, image.height], channels, &attributes)
}

/// Writes the channels `R G B` of a picture of `size` = width, height, in full precision, with `attributes` as text
/// attributes. Whole or not at all.
///
/// # Errors
/// As [`write()`].
pub fn write_rgb(
    path: &Path,
    size: [usize; 2],
    rgb: &[[f32; 3]],
    attributes: &BTreeMap<String, String>,
) -> Result<()> {
    let mut channels = Channels::new();
    push_triples(&mut channels, "", RGB, rgb);
    write_channels(path, size, channels, attributes)
}

/// What the library takes as channels.
type Channels = SmallVec<[AnyChannel<FlatSamples>; 4]>;

fn push_triples(channels: &mut Channels, group: &str, letters: [&str; 3], pixels: &[[f32; 3]]) {
    for (c, letter) in letters.iter().enumerate() {
        let samples = pixels.iter().map(|p| p[c]).collect();
        let name = channel_name(group, letter);
        channels.push(AnyChannel::new(name.as_str(), FlatSamples::F32(samples)));
    }
}

fn write_channels(
    path: &Path,
    size: [usize; 2],
    channels: Channels,
    texts: &BTreeMap<String, String>,
) -> Result<()> {
    let mut attributes = LayerAttributes::default();
    for (key, value) in texts {
        attributes.other.insert(
            Text::from(key.as_str()),
            AttributeValue::Text(Text::from(value.as_str())),
        );
    }
    let layer = Layer::new(
        (size[0], size[1]),
        attributes,
        Encoding::SMALL_LOSSLESS,
        AnyChannels::sort(channels),
    );
    let mut bytes = Cursor::new(Vec::new());
    exr::prelude::Image::from_layer(layer)
        .write()
        .to_buffered(&mut bytes)
        .map_err(|e| Error::image_file(path, e.to_string()))?;
    Ok(write_atomically(path, &bytes.into_inner())?)
}

/// Reads back what [`write()`] wrote.
///
/// # Errors
/// [`Error::Io`], or [`Error::ImageFile`] when the file is damaged or lacks a channel or count.
pub fn read(path: &Path) -> Result<Image> {
    let layer = read_layer(path)?;
    let mut image = Image::new(layer.size.width(), layer.size.height());
    for (key, value) in &layer.attributes.other {
        if let AttributeValue::Text(value) = value {
            image.attributes.insert(key.to_string(), value.to_string());
        }
    }
    let mut count = |key: &str| {
        let text = image.attributes.remove(key).and_then(|text| text.parse().ok());
        text.ok_or_else(|| Error::image_file(path, format!("attribute `{key}` is missing or not a number")))
    };
    (image.spp, image.non_finite) = (count(SPP_KEY)?, count(NON_FINITE_KEY)?);
    image.rgb = triples(path, &layer, "", RGB)?;
    image.variance = triples(path, &layer, "variance", RGB)?;
    image.albedo = triples(path, &layer, "albedo", RGB)?;
    image.normal = triples(path, &layer, "normal", XYZ)?;
    image.object = channel(path, &layer, "object")?;
    Ok(image)
}

/// Reads the channels `R G B` of a latitude–longitude map with the axes of [`Environment`].
///
/// # Errors
/// [`Error::Io`], or [`Error::ImageFile`] when the file is damaged or a texel is negative, infinite or NaN.
pub fn read_environment(path: &Path) -> Result<Environment> {
    let layer = read_layer(path)?;
    let texels = triples(path, &layer, "", RGB)?;
    check_radiance(path, &layer, &texels)?;
    Ok(Environment::new(
        layer.size.width(),
        layer.size.height(),
        texels.into_iter().map(Vec3::from).collect(),
    ))
}

/// Width, height and the radiance of a picture: its channels `R G B`, or `Y` three times where it has no colours.
///
/// # Errors
/// As [`read_environment`].
pub(crate) fn read_radiance(path: &Path) -> Result<([usize; 2], Vec<[f32; 3]>)> {
    let layer = read_layer(path)?;
    let grey = channel(path, &layer, RGB[0]).is_err() && channel(path, &layer, LUMINANCE).is_ok();
    let texels = triples(path, &layer, "", if grey { [LUMINANCE; 3] } else { RGB })?;
    check_radiance(path, &layer, &texels)?;
    Ok(([layer.size.width(), layer.size.height()], texels))
}

fn check_radiance(path: &Path, layer: &FlatLayer, texels: &[[f32; 3]]) -> Result<()> {
    let bad = |t: &[f32; 3]| t.iter().any(|v| !v.is_finite() || *v < 0.0);
    let Some(i) = texels.iter().position(bad) else {
        return Ok(());
    };
    let (x, y) = (i % layer.size.width(), i / layer.size.width());
    let reason = format!(
        "texel ({x}, {y}) is {:?}, but radiance must be finite and at least 0",
        texels[i]
    );
    Err(Error::image_file(path, reason))
}

/// The channel of pictures without colours.
const LUMINANCE: &str = "Y";

const RGB: [&str; 3] = ["R", "G", "B"];
const XYZ: [&str; 3] = ["X", "Y", "Z"];

/// Channels are named after the layer they belong to, as compositing programs expect; the picture has none.
fn channel_name(group: &str, letter: &str) -> String {
    if group.is_empty() {
        letter.to_owned()
    } else {
        format!("{group}.{letter}")
    }
}

fn read_layer(path: &Path) -> Result<FlatLayer> {
    let bytes = std::fs::read(path).map_err(|source| Error::io(path, source))?;
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| Error::image_file(path, e.to_string()))?;
    Ok(image.layer_data)
}

fn channel(path: &Path, layer: &FlatLayer, name: &str) -> Result<Vec<f32>> {
    let channel = layer
        .channel_data
        .list
        .iter()
        .find(|c| c.name.eq_case_insensitive(name));
    let channel = channel.ok_or_else(|| Error::image_file(path, format!("channel `{name}` is missing")))?;
    let samples: Vec<f32> = channel.sample_data.values_as_f32().collect();
    if samples.len() != layer.size.area() {
        return Err(Error::image_file(path, format!("channel `{name}` is subsampled")));
    }
    Ok(samples)
}

fn triples(path: &Path, layer: &FlatLayer, group: &str, letters: [&str; 3]) -> Result<Vec<[f32; 3]>> {
    let [a, b, c] = letters.map(|letter| channel(path, layer, &channel_name(group, letter)));
    let (a, b, c) = (a?, b?, c?);
    Ok((0..a.len()).map(|i| [a[i], b[i], c[i]]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbered() -> Image {
        let mut image = Image::new(5, 3);
        let mut next = 0.1;
        for array in [
            &mut image.rgb,
            &mut image.variance,
            &mut image.albedo,
            &mut image.normal,
        ] {
            for value in array.iter_mut().flatten() {
                *value = next;
                next *= -1.37;
            }
        }
        image.object = (0..15).map(|i| i as f32).collect();
        (image.spp, image.non_finite) = (1 << 40, 3);
        image.attributes.insert("method".into(), "reference".into());
        image
    }

    #[test]
    fn image_round_trip_is_exact() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image.exr");
        write(&path, &numbered()).unwrap();
        assert_eq!(read(&path).unwrap(), numbered());
    }

    #[test]
    fn plain_pictures_hold_three_channels() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plain.exr");
        let pixels: Vec<[f32; 3]> = (0..6).map(|i| [i as f32, 0.5, 1e9]).collect();
        let attributes = BTreeMap::from([("theta".to_string(), "45".to_string())]);
        write_rgb(&path, [3, 2], &pixels, &attributes).unwrap();
        let layer = read_layer(&path).unwrap();
        assert_eq!((layer.size.width(), layer.channel_data.list.len()), (3, 3));
        assert_eq!(triples(&path, &layer, "", RGB).unwrap(), pixels);
        let theta = layer.attributes.other.get(&Text::from("theta"));
        assert_eq!(theta, Some(&AttributeValue::Text(Text::from("45"))));
    }

    #[test]
    fn pictures_without_colours_hold_one_channel() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("grey.exr");
        let samples = FlatSamples::F32(vec![0.5, 2.0]);
        let channels = Channels::from_iter([AnyChannel::new(LUMINANCE, samples)]);
        write_channels(&path, [2, 1], channels, &BTreeMap::new()).unwrap();
        assert_eq!(read_radiance(&path).unwrap(), ([2, 1], vec![[0.5; 3], [2.0; 3]]));
        let lacking = read_environment(&path).unwrap_err().to_string();
        assert!(lacking.contains("channel `R` is missing"), "{lacking}");
    }

    #[test]
    fn damaged_and_foreign_files_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image.exr");
        write(&path, &numbered()).unwrap();
        // Negative texels are no radiance.
        assert!(
            read_environment(&path)
                .unwrap_err()
                .to_string()
                .contains("texel (0, 0)")
        );
        let bytes = std::fs::read(&path).unwrap();
        for damaged in [&bytes[..bytes.len() / 2], b"not an image"] {
            std::fs::write(&path, damaged).unwrap();
            assert!(matches!(read(&path), Err(Error::ImageFile { .. })));
        }
        assert!(matches!(
            read(&folder.path().join("none.exr")),
            Err(Error::Io { .. })
        ));
        let unwritable = write(&path.join("below-a-file.exr"), &numbered()).unwrap_err();
        assert!(unwritable.to_string().contains("below-a-file.exr"));
    }
}
