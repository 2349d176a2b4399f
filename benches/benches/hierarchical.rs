//! What do a hierarchy, its links and a product along them cost?
//!
//! The Cornell box with 32 × 32 and 64 × 64 elements a face, links for light that is equally bright everywhere at a threshold of 1e-4.
//! Throughput counts elements for the hierarchy, links for making them and for a product of three bands.

use std::sync::Arc;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use radiosity::Geometry;
use radiosity_benches::cornell;
use radiosity_core::{BandValues, FormFactors};
use radiosity_form_factors::analytic::Analytic;
use radiosity_form_factors::hierarchical::{Brightness, HierarchicalFormFactors, Hierarchy, Linking};
use radiosity_geometry::Subdivision;
use radiosity_geometry::mesh::MeshSettings;

fn hierarchical(c: &mut Criterion) {
    let scene = cornell();
    let mut group = c.benchmark_group("hierarchical");
    group.sample_size(10);
    for divisions in [32, 64] {
        let settings = MeshSettings { elements: Subdivision::Uniform(divisions), patches: None, contacts: true };
        let geometry = Geometry::new(&scene, &settings).expect("a sound scene");
        let (elements, blockers) = (geometry.elements(), geometry.blockers());
        let (m, tree) = (elements.len(), || Hierarchy::new(geometry.mesh(), geometry.exposed(), elements));
        group.throughput(Throughput::Elements(m as u64));
        group.bench_function(BenchmarkId::new("nodes", m), |bench| bench.iter(tree));

        let tree = Arc::new(tree());
        let uniform = Brightness::uniform(&tree);
        let linking = Linking::new(&tree, elements, blockers, Analytic::new(Some(blockers)), 1e-6, 1);
        let links = linking.links(1e-4, &uniform).0;
        group.throughput(Throughput::Elements(links.len() as u64));
        group.bench_function(BenchmarkId::new("links", m), |bench| bench.iter(|| linking.links(1e-4, &uniform)));

        let store = HierarchicalFormFactors::new(Arc::clone(&tree), &links);
        let (x, mut y) = (BandValues::new(vec![1.0; 3 * m], m), BandValues::zeros(3, m));
        group.bench_function(BenchmarkId::new("product", m), |bench| {
            bench.iter(|| store.gather(x.view(), y.view_mut()).expect("links do not fail"));
        });
        group.bench_function(BenchmarkId::new("final-gather", m), |bench| bench.iter(|| store.final_gather(x.view())));
    }
    group.finish();
}

criterion_group!(benches, hierarchical);
criterion_main!(benches);
