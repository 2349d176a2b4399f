//! What holds of every distribution function, by quadrature over the sphere that knows nothing of how they are sampled.

use super::*;

/// Directions to view from, in plane and out of it, steep and grazing.
fn views() -> Vec<DVec3> {
    let angles = [(0.0, 0.0), (0.3, 1.0), (0.8, 2.5), (1.2, 4.0), (1.5, 5.5)];
    angles.map(|(t, p): (f64, f64)| DVec3::new(t.sin() * p.cos(), t.sin() * p.sin(), t.cos())).to_vec()
}

/// Functions with their name and whether they have an f at all; reflectances so high that an excess of energy would show.
fn functions() -> Vec<(&'static str, Box<dyn Bsdf>)> {
    let white = || vec![1.0, 0.9];
    let gold = || (vec![0.25, 1.5], vec![3.07, 1.9]);
    let mut all: Vec<(&'static str, Box<dyn Bsdf>)> = vec![
        ("Lambert", Box::new(Lambert::new(white()))),
        ("Oren-Nayar 0.4", Box::new(OrenNayar::new(white(), 0.4))),
        ("Oren-Nayar 1", Box::new(OrenNayar::new(white(), 1.0))),
        ("Phong 0", Box::new(Phong::new(white(), 0.0))),
        ("Phong 30", Box::new(Phong::new(white(), 30.0))),
    ];
    for roughness in [0.15, 0.5, 1.0] {
        let (index, absorption) = gold();
        all.push(("conductor", Box::new(Conductor::new(index, absorption, roughness))));
        all.push(("dielectric", Box::new(Dielectric::new(1.5, white(), roughness))));
    }
    all
}

/// ∫ g dω over the half sphere of `peak`, graded towards it: θ and φ are squares of what runs evenly, about those of the peak.
fn half_sphere(peak: DVec3, g: &mut dyn FnMut(DVec3) -> f64) -> f64 {
    const STEPS: usize = 480;
    let (side, middle) = (peak.z.signum(), peak.z.abs().min(1.0).acos());
    let (least, most) = (-middle.sqrt(), (0.5 * PI - middle).max(0.0).sqrt());
    let azimuth = peak.y.atan2(peak.x);
    let mut sum = 0.0;
    for k in 0..STEPS {
        let t = least + (most - least) * (k as f64 + 0.5) / STEPS as f64;
        let theta = middle + t * t.abs();
        let step = 2.0 * t.abs() * (most - least) / STEPS as f64 * theta.sin();
        for l in 0..STEPS {
            let r = -1.0 + 2.0 * (l as f64 + 0.5) / STEPS as f64;
            let phi = azimuth + PI * r * r.abs();
            let w = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), side * theta.cos());
            sum += step * 4.0 * PI * r.abs() / STEPS as f64 * g(w);
        }
    }
    sum
}

/// ∫ g dω over the sphere, where g peaks near the directions that o is mirrored to and refracted to.
fn sphere(o: DVec3, g: &mut dyn FnMut(DVec3) -> f64) -> f64 {
    let n = if o.z > 0.0 { 1.5 } else { 1.0 / 1.5 };
    let across = -o.truncate() / n;
    let refracted = across.extend(-o.z.signum() * (1.0 - across.length_squared()).max(1e-4).sqrt()).normalize();
    half_sphere(mirrored(o, DVec3::Z), g) + half_sphere(refracted, g)
}

/// Views from the front, and from behind where something happens there.
fn sided(name: &str) -> Vec<DVec3> {
    let front = views();
    if name == "dielectric" { front.iter().copied().chain(front.iter().map(|o| -*o)).collect() } else { front }
}

#[test]
fn frames_are_orthonormal_and_right_handed() {
    for n in views().into_iter().chain(views().into_iter().map(|v| -v)) {
        let frame = Frame::new(n);
        let (x, y) = (frame.scene(DVec3::X), frame.scene(DVec3::Y));
        assert!((x.cross(y) - n).length() < 1e-15 && (x.length() - 1.0).abs() < 1e-15 && x.dot(y).abs() < 1e-15);
        assert!((frame.local(frame.scene(DVec3::new(0.1, 0.2, 0.3))) - DVec3::new(0.1, 0.2, 0.3)).length() < 1e-15);
    }
}

/// f(o, i)/n_i² = f(i, o)/n_o²: the index is 1 in front and 1.5 behind where there is a back.
#[test]
fn functions_are_reciprocal() {
    for (name, function) in functions() {
        let index = |w: DVec3| if name == "dielectric" && w.z < 0.0 { 1.5_f64 } else { 1.0 };
        for o in sided(name) {
            for i in sided(name) {
                let (mut there, mut back) = ([0.0; 2], [0.0; 2]);
                function.evaluate(o, i, &mut there);
                function.evaluate(i, o, &mut back);
                for (f, g) in there.into_iter().zip(back) {
                    let (f, g) = (f / index(i).powi(2), g / index(o).powi(2));
                    assert!((f - g).abs() <= 1e-12 * f.max(g), "{name}, o {o}, i {i}: {f} and {g}");
                }
            }
        }
    }
}

/// The albedo by quadrature of f cosθ is at most 1 at every angle, and that of [`Bsdf::albedo`], which goes by samples, to 1 %.
#[test]
fn no_angle_reflects_more_than_arrives() {
    for (name, function) in functions() {
        for o in sided(name) {
            let mut a = [0.0; 2];
            function.albedo(o, &mut a);
            for band in 0..2 {
                let mut f = [0.0; 2];
                let mut integrand = |i: DVec3| {
                    function.evaluate(o, i, &mut f);
                    f[band] * i.z.abs()
                };
                let sum = sphere(o, &mut integrand);
                assert!(sum <= 1.0 + 1e-4, "{name} from {o}: {sum}");
                assert!((sum - a[band]).abs() <= 1e-2, "{name} from {o}, band {band}: {sum}, by samples {}", a[band]);
            }
        }
    }
}

/// ∫ density dω is the share of samples that are not lost; both to 1 %.
#[test]
fn densities_integrate_to_the_share_of_samples_that_go_on() {
    const COUNT: usize = 4096;
    for (name, function) in functions() {
        for o in sided(name) {
            let sum = sphere(o, &mut |i| function.density(o, i));
            let mut kept = 0;
            for k in 0..COUNT {
                let u = [0.819_172_5, 0.671_043_6, 0.549_700_5].map(|step: f64| (0.5 + step * k as f64).fract());
                kept += usize::from(function.sample(o, u, &mut [1.0; 2]).is_some());
            }
            let kept = kept as f64 / COUNT as f64;
            assert!((sum - kept).abs() < 1e-2, "{name} from {o}: {sum}, kept {kept}");
        }
    }
}

/// Every sample has the density that is stated for its direction, and weighs f cosθ / density.
#[test]
fn samples_weigh_what_they_should() {
    for (name, function) in functions() {
        for o in sided(name) {
            for k in 0..200_u32 {
                let u = [0.754_877, 0.569_84, 0.618_034].map(|g: f64| (g * f64::from(k + 1)).fract());
                let mut weight = [1.0; 2];
                let Some(sampled) = function.sample(o, u, &mut weight) else { continue };
                let (i, density) = (sampled.direction, sampled.density.expect("rough"));
                let mut f = [0.0; 2];
                function.evaluate(o, i, &mut f);
                assert!((i.length() - 1.0).abs() < 1e-12);
                // Rounding is that of the facet found again from two directions.
                assert!((function.density(o, i) / density - 1.0).abs() < 1e-6, "{name} from {o}");
                for (w, f) in weight.into_iter().zip(f) {
                    assert!((w - f * i.z.abs() / density).abs() < 1e-6 * w, "{name} from {o}: {w}");
                }
            }
        }
    }
}

/// A smooth boundary sends the share F back and the rest on by Snell's law; nothing is lost, whichever side light comes from.
#[test]
fn smooth_glass_splits_light_by_fresnel_and_snell() {
    let glass = Dielectric::new(1.5, vec![1.0], 0.0);
    for o in sided("dielectric") {
        let n = if o.z > 0.0 { 1.5 } else { 1.0 / 1.5 };
        let (reflected, _) = fresnel::dielectric(o.z.abs(), n);
        for (u, back) in [(0.5 * reflected, true), (reflected + 0.5 * (1.0 - reflected), false)] {
            if u >= 1.0 || (back && reflected == 0.0) || (!back && reflected == 1.0) {
                continue;
            }
            let mut weight = [1.0];
            let i = glass.sample(o, [0.5, 0.5, u], &mut weight).unwrap().direction;
            assert_eq!((weight, i.z * o.z > 0.0), ([1.0], back));
            let sines = (o.truncate().length(), i.truncate().length());
            let ratio = if back { 1.0 } else { n };
            assert!((sines.0 - ratio * sines.1).abs() < 1e-14 && i.truncate().dot(o.truncate()) <= 0.0, "from {o}");
        }
    }
}

/// As roughness goes to 0, microfacets mirror like a smooth surface: the albedo is F at the angle itself.
#[test]
fn rough_metal_becomes_smooth() {
    for o in views().into_iter().filter(|o| o.z > 0.3) {
        let (mut rough, mut smooth) = ([0.0], [0.0]);
        Conductor::new(vec![0.25], vec![3.07], 1e-3).albedo(o, &mut rough);
        Conductor::new(vec![0.25], vec![3.07], 0.0).albedo(o, &mut smooth);
        assert!((rough[0] - smooth[0]).abs() < 1e-4 && (smooth[0] - fresnel::conductor(o.z, 0.25, 3.07)).abs() < 1e-12);
    }
}

/// What [`Specular::conductor`] stands for reflects what was asked at normal incidence.
#[test]
fn metals_are_found_by_their_normal_reflectance() {
    let mut a = [0.0; 3];
    of_specular(&Specular::conductor(&[0.0, 0.5, 0.95], 0.0)).albedo(DVec3::Z, &mut a);
    for (a, asked) in a.into_iter().zip([0.0, 0.5, 0.95]) {
        assert!((a - asked).abs() < 1e-12);
    }
}
