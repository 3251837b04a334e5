//! Batches of vectors as structures of arrays, the form that networks take.

use glam::{DVec3, Vec3};

/// Vectors (directions or RGB values), one array per component.
#[derive(Clone, Debug, Default)]
pub struct Lanes([Vec<f32>; 3]);

impl Lanes {
    /// Number of vectors.
    pub fn len(&self) -> usize {
        self.0[0].len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Makes it `len` vectors long; new ones are zero.
    pub fn resize(&mut self, len: usize) {
        self.0.iter_mut().for_each(|component| component.resize(len, 0.0));
    }

    /// Removes all vectors.
    pub fn clear(&mut self) {
        self.resize(0);
    }

    /// Appends `v`.
    pub fn push(&mut self, v: Vec3) {
        for (component, value) in self.0.iter_mut().zip(v.to_array()) {
            component.push(value);
        }
    }

    /// Vector number `i`.
    pub fn at(&self, i: usize) -> Vec3 {
        Vec3::new(self.0[0][i], self.0[1][i], self.0[2][i])
    }

    /// Direction number `i` in f64, made unit again to that precision.
    pub fn unit_at(&self, i: usize) -> DVec3 {
        self.at(i).as_dvec3().normalize()
    }

    /// Replaces vector number `i`.
    pub fn set(&mut self, i: usize, v: Vec3) {
        for (component, value) in self.0.iter_mut().zip(v.to_array()) {
            component[i] = value;
        }
    }

    /// The three arrays.
    pub fn slices(&self) -> [&[f32]; 3] {
        self.0.each_ref().map(Vec::as_slice)
    }

    /// The three arrays, to be written.
    pub fn slices_mut(&mut self) -> [&mut [f32]; 3] {
        self.0.each_mut().map(Vec::as_mut_slice)
    }
}
