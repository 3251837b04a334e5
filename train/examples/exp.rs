// Throwaway: bake a material and measure binning and relvar with the f64 oracle-like path.
use bake_runtime::bsdf::shifted_r2;
use bake_runtime::simd::Tier;
use bake_runtime::*;
use bake_train::bake::*;
use bake_train::card::binned::BinnedSlice;
use bake_train::card::bins::l1;
use bake_train::fused::Fused;
use bake_train::lobes::*;
use bake_train::presets::Preset;
use bake_train::training::mlp::Mlp;
use bake_train::training::sample::Warp;
use glam::DVec3;
use rayon::prelude::*;
use std::path::Path;
#[global_allocator]
static A: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn material(path: &str) -> Material {
    let text = std::fs::read_to_string(path).unwrap();
    let table: toml::Value = toml::from_str(&text).unwrap();
    let json = serde_json::to_string(&table).unwrap();
    let fields: field::Fields = serde_json::from_str(&json).unwrap();
    let name = Path::new(path).file_stem().unwrap().to_str().unwrap();
    Material::read(name, fields, Path::new("")).unwrap()
}

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let m = material(&args[1]);
    let work = Path::new(&args[2]);
    let n: Vec<u64> = args[3].split(',').map(|v| v.parse().unwrap()).collect();
    std::fs::create_dir_all(work).unwrap();
    let effort = Effort {
        slices: n[0] as usize,
        steps: [n[1], n[2], n[3], n[4]],
        batch: n[5] as usize,
    };
    let t0 = std::time::Instant::now();
    let last = std::sync::Mutex::new((None, std::time::Instant::now()));
    let b = bake(&m, Preset::Warp, effort, 1, work, &|stage, done, total| {
        let mut l = last.lock().unwrap();
        if l.0 != Some(stage) {
            if let Some(s) = l.0 {
                eprintln!("{s:?} {:.1}s", l.1.elapsed().as_secs_f64());
            }
            *l = (Some(stage), std::time::Instant::now());
        }
        if done % (total / 5).max(1) == 0 {
            eprintln!("  {stage:?} {done}/{total} {:.1}s", l.1.elapsed().as_secs_f64());
        }
        std::ops::ControlFlow::Continue(())
    })
    .unwrap();
    eprintln!(
        "total {:.1}s maps {:.1} train {:.1} fallback {:.4} macs {} params {}",
        t0.elapsed().as_secs_f64(),
        b.maps_seconds,
        b.train_seconds,
        b.maps.fallback_share(),
        b.material.sample.spec.macs(),
        b.material.sample.spec.parameters()
    );
    b.material.save(&work.join("baked")).unwrap();
    measure(&m, &b.material);
}

fn measure(m: &Material, baked: &BakedMaterial) {
    let free = m.free();
    let strata = [(5.0, 75.0), (75.0, 85.0), (85.0, 89.0)];
    for (lo, hi) in strata {
        let count = 24;
        let rows: Vec<[f64; 6]> = (0..count).into_par_iter().map(|k| {
            let x = |d: u64| ((k as f64 + 0.5) * 0.7548776662466927 * (1.0 + d as f64 * 0.618) + 0.37 * d as f64).fract();
            let theta = lo + (hi - lo) * (k as f64 + 0.5) / count as f64;
            let phi = 360.0 * x(11);
            let params: Vec<f64> = free.iter().enumerate().map(|(d, (l, a, b))| bake_train::places::value_at(l, *a, *b, x(d as u64))).collect();
            let wo = bsdf::direction(theta, phi);
            let bsdf = m.bind(&params).unwrap();
            let slice = LobeSlice::new(&bsdf, wo, 2048, 3).unwrap();
            let chart = slice.sharp_chart().unwrap_or(slice.chart(Lobe::Whole));
            let truth = BinnedSlice::new(&bsdf, wo, &chart);
            let floor = truth.floor(1 << 18);
            let (l, relvar, wmax, fold, mixvar) = sampler(baked, &params, wo, &slice, &truth, 1 << 18);
            if std::env::var("V").is_ok() { eprintln!("th {theta:.1} phi {phi:.0} {params:.3?} l1 {l:.4} (floor {floor:.4}) relvar {relvar:.5} mix {mixvar:.5} max {wmax:.1} fold {fold:.5}"); }
            let (er, pi) = densities(baked, &params, wo, &slice, &chart);
            [l, relvar, mixvar, er, (pi - 1.0).abs(), floor]
        }).collect();
        let mean = |i: usize| rows.iter().map(|r| r[i]).sum::<f64>() / rows.len() as f64;
        let med = |i: usize| {
            let mut v: Vec<f64> = rows.iter().map(|r| r[i]).collect();
            v.sort_by(f64::total_cmp);
            v[v.len() / 2]
        };
        println!(
            "{lo}-{hi}: l1 {:.4} (median {:.4}, floor {:.4}) relvar {:.5} (med {:.5}) partition {:.5} eval {:.4} |pdf-1| {:.4}",
            mean(0),
            med(0),
            mean(5),
            mean(1),
            med(1),
            mean(2),
            mean(3),
            mean(4)
        );
    }
}

fn densities(
    baked: &BakedMaterial,
    params: &[f64],
    wo: DVec3,
    slice: &LobeSlice,
    chart: &chart::Chart,
) -> (f64, f64) {
    let (mut err, mut en, mut pi) = (0.0, 0.0, 0.0);
    let n = 1500;
    let id = chart::Chart::IDENTITY;
    for i in 0..n {
        let s = shifted_r2(i, [0.1, 0.3]);
        let c = if i % 2 == 0 { chart } else { &id };
        let (wi, _) = c.square_to_direction(shifted_r2(i / 2, s));
        let p = 0.5 * chart.density(wi) + 0.5 * id.density(wi);
        let f = slice.f_cos(Lobe::Whole, DVec3::from_array(wi));
        let e = DVec3::from_array(oracle::eval(&baked.eval, params, wo.to_array(), wi));
        err += (e - f).abs().element_sum() / p;
        en += f.element_sum() / p;
        pi += oracle::pdf(&baked.pdf, params, wo.to_array(), wi).0 / p;
    }
    (err / en, pi / n as f64)
}

fn sampler(
    baked: &BakedMaterial,
    params: &[f64],
    wo: DVec3,
    slice: &LobeSlice,
    truth: &BinnedSlice,
    n: usize,
) -> (f64, f64, f64, f64, f64) {
    let net = &baked.sample;
    let (folded, turn) = oracle::fold(net.spec.symmetry, wo.to_array());
    let charts = oracle::charts_of(net, params, folded);
    let mlp = Mlp {
        layers: net.spec.layers(),
        values: net
            .net
            .iter()
            .flat_map(|d| d.weight.iter().chain(&d.bias).copied().collect::<Vec<_>>())
            .collect(),
    };
    let shape = bake_train::training::trainer::shape(&mlp.layers, net.spec.activation).unwrap();
    let mut kernel = Fused::new(Tier::best(), shape, 3).unwrap();
    let mut counts = vec![0u64; 64 * 64];
    let (mut s1, mut s2, mut wmax, mut folds) = (0.0f64, 0.0f64, 0.0f64, 0);
    let (mut q1, mut q2) = (0.0, 0.0);
    let width = net.spec.input_features();
    let chunk = 4096;
    for start in (0..n).step_by(chunk) {
        let mut rows = vec![0f32; 3 * chunk * width];
        let mut meta = Vec::new();
        for i in 0..chunk {
            let mut u = shifted_r2((start + i) as u64, [0.0; 2]);
            let mut c = 0;
            if charts.len() == 2 {
                let f = charts[0].0;
                if u[0] < f {
                    u[0] /= f
                } else {
                    u[0] = (u[0] - f) / (1.0 - f);
                    c = 1
                }
            }
            let u = u.map(|v| v.clamp(1e-6, 1.0 - 1e-6));
            let mut p = features::Point::new(params, folded, net.spec.charts());
            p.u = u;
            p.chart = c;
            let mut f = Vec::new();
            p.append(&net.spec.inputs, &mut f);
            for (k, v) in f.iter().enumerate() {
                rows[i * width + k] = *v as f32;
            }
            rows[(chunk + i) * width] = 2.0;
            rows[(2 * chunk + i) * width + 1] = 2.0;
            meta.push((u, c));
        }
        let out = kernel.forward(&mlp.values, &rows).unwrap();
        let at = |col: usize, i: usize, c: usize| out[(col * chunk + i) * 5 + c];
        for (i, (u, c)) in meta.iter().enumerate() {
            let w = Warp::new(
                u.map(|v| v as f32),
                [at(0, i, 0), at(0, i, 1)],
                [[at(1, i, 0), at(2, i, 0)], [at(1, i, 1), at(2, i, 1)]],
            );
            let (share, chart) = &charts[*c];
            let (wi, area) = chart.square_to_direction(w.h);
            let det = w.det();
            if det < 0.0 {
                folds += 1
            }
            let wi = oracle::unfold(turn, wi);
            let wi3 = DVec3::from_array(wi);
            counts[truth.bins.index(wi3)] += 1;
            if i % 4 != 0 {
                continue;
            }
            let f = slice.f_cos(Lobe::Whole, wi3).dot(LUMINANCE);
            let jac = area * det / share;
            let part = if charts.len() == 2 {
                let (t, p) = oracle::pdf(&baked.pdf, params, wo.to_array(), wi);
                p[*c] / t
            } else {
                1.0
            };
            let y = f * jac * part;
            s1 += y;
            s2 += y * y;
            wmax = wmax.max(y);
            if charts.len() == 2 {
                // ideal partition by own lobes
                let own = slice
                    .f_cos(if *c == 0 { Lobe::Sharp } else { Lobe::Smooth }, wi3)
                    .dot(LUMINANCE);
                let y = own * jac;
                q1 += y;
                q2 += y * y;
            }
        }
    }
    let m = n as f64 / 4.0;
    let (mean, mean_q) = (s1 / m, q1 / m);
    (
        l1(&counts, &truth.mass),
        s2 / m / (mean * mean) - 1.0,
        wmax / mean,
        folds as f64 / n as f64,
        if charts.len() == 2 {
            q2 / m / (mean_q * mean_q) - 1.0
        } else {
            0.0
        },
    )
}
