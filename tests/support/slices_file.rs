//! A file of the family `imported`, written byte by byte from what its documentation says, and by nothing else.

use std::path::Path;

/// What a file holds; every field may be spoiled before it is written.
pub struct SlicesFile {
    /// Names of the parameters.
    pub names: Vec<&'static str>,
    /// One row per slice: the parameters, then θ and φ of `wo` in degrees.
    pub rows: Vec<Vec<f32>>,
    /// Pixels per side of a slice.
    pub side: usize,
    /// `f_cos`, RGB, sr⁻¹, pixel by pixel and slice by slice.
    pub f_cos: Vec<f32>,
}

impl SlicesFile {
    /// Tabulates `f` (RGB, sr⁻¹, without the cosine), of the row and of `wi`, at every combination of values of the
    /// parameter `name` and of θ; the BSDF is isotropic, and slices are those of φ = 0.
    pub fn isotropic(
        name: &'static str,
        values: &[f32],
        thetas: &[f32],
        side: usize,
        f: impl Fn([f64; 2], [f64; 3]) -> [f64; 3],
    ) -> SlicesFile {
        let rows = values
            .iter()
            .flat_map(|&value| thetas.iter().map(move |&theta| vec![value, theta, 0.0]));
        let mut file = SlicesFile {
            names: vec![name],
            rows: rows.collect(),
            side,
            f_cos: Vec::new(),
        };
        let centre = |k: usize| -1.0 + (2 * k + 1) as f64 / side as f64;
        for row in &file.rows {
            let row = [row[0], row[1]].map(f64::from);
            for (i, j) in (0..side).flat_map(|i| (0..side).map(move |j| (i, j))) {
                let (x, y) = (centre(j), centre(i));
                let z = (1.0 - x * x - y * y).max(0.0).sqrt();
                file.f_cos.extend(f(row, [x, y, z]).map(|v| (v * z) as f32));
            }
        }
        file
    }

    /// Writes it: the length of the header, the header in JSON, and the tensors one after another.
    pub fn write(&self, path: &Path) {
        let (n, p) = (self.rows.len(), self.names.len());
        let params: Vec<f32> = self.rows.iter().flat_map(|row| row[..p].to_vec()).collect();
        let wo: Vec<f32> = self.rows.iter().flat_map(|row| row[p..].to_vec()).collect();
        let names: Vec<String> = self.names.iter().map(|name| format!(r#"\"{name}\""#)).collect();
        let mut header = format!(
            r#"{{"__metadata__": {{"bake.import": "1", "param_names": "[{}]"}}"#,
            names.join(", ")
        );
        let mut data = Vec::new();
        let tensors = [
            ("params", vec![n, p], &params),
            ("wo", vec![n, 2], &wo),
            ("f_cos", vec![n, self.side, self.side, 3], &self.f_cos),
        ];
        for (name, shape, values) in tensors {
            let begin = data.len();
            data.extend(values.iter().flat_map(|v| v.to_le_bytes()));
            header += &format!(
                r#", "{name}": {{"dtype": "F32", "shape": {shape:?}, "data_offsets": [{begin}, {}]}}"#,
                data.len()
            );
        }
        header += "}";
        let length = (header.len() as u64).to_le_bytes();
        std::fs::write(path, [&length, header.as_bytes(), &data].concat()).expect("it can be written");
    }
}
