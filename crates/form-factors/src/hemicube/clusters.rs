//! The polygons of a scene in runs that lie together, made once: what a hemicube looks through.

use glam::DVec3;
use radiosity_geometry::Polygon;

use super::solids::Solids;

/// Polygons of a cluster: enough to pay for the test of its sphere, few enough to lie in a small one.
const POLYGONS: usize = 32;

/// A run of polygons inside a sphere.
#[derive(Clone, Debug)]
pub(super) struct Cluster {
    pub centre: DVec3,
    pub radius: f64,
    /// Largest coordinate of a corner.
    pub reach: f64,
    /// Its polygons.
    pub polygons: std::ops::Range<usize>,
    /// Its corners, each once.
    pub corners: std::ops::Range<usize>,
}

/// A polygon of a cluster.
#[derive(Clone, Debug)]
pub(super) struct Member {
    /// Which polygon of the scene it is.
    pub polygon: u32,
    /// The closed body it belongs to, if any.
    pub body: u32,
    pub normal: DVec3,
    pub centroid: DVec3,
    pub thickness: f64,
    /// Its corners: places in the cluster's.
    pub loop_: std::ops::Range<usize>,
}

/// Clusters of polygons with their corners.
#[derive(Clone, Debug, Default)]
pub(super) struct Clusters {
    pub clusters: Vec<Cluster>,
    pub members: Vec<Member>,
    /// Coordinates x, y and z of all corners.
    pub corners: [Vec<f64>; 3],
    /// Loops of corners of all members, counted from the first corner of the cluster.
    pub loops: Vec<u32>,
    pub solids: Solids,
}

impl Clusters {
    /// Clusters along a space-filling curve through the centroids.
    pub fn new(polygons: &[&Polygon]) -> Self {
        let (solids, body) = Solids::of(polygons);
        let mut all = Self { solids, ..Self::default() };
        for run in curve(polygons).chunks(POLYGONS) {
            all.push(polygons, run, &body);
        }
        all
    }

    /// Adds the polygons of `run` as a cluster.
    fn push(&mut self, polygons: &[&Polygon], run: &[u32], body: &[u32]) {
        let (mut corners, first) = (Vec::<DVec3>::new(), self.members.len());
        for &k in run {
            let (polygon, begin) = (polygons[k as usize], self.loops.len());
            for &v in polygon.vertices() {
                let place = corners.iter().position(|&c| c == v).unwrap_or_else(|| {
                    corners.push(v);
                    corners.len() - 1
                });
                self.loops.push(place as u32);
            }
            self.members.push(Member {
                polygon: k,
                body: body[k as usize],
                normal: polygon.normal(),
                centroid: polygon.centroid(),
                thickness: polygon.thickness(),
                loop_: begin..self.loops.len(),
            });
        }
        let (lo, hi) = bounds(corners.iter().copied());
        let (centre, at) = (0.5 * (lo + hi), self.corners[0].len());
        self.clusters.push(Cluster {
            centre,
            radius: corners.iter().map(|c| c.distance(centre)).fold(0.0, f64::max),
            reach: lo.abs().max(hi.abs()).max_element(),
            polygons: first..self.members.len(),
            corners: at..at + corners.len(),
        });
        for (axis, values) in self.corners.iter_mut().enumerate() {
            values.extend(corners.iter().map(|c| c[axis]));
        }
    }
}

fn bounds(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)))
}

/// The polygons in the order of Morton's curve (1966) through a grid of 1024³ cells around their centroids.
fn curve(polygons: &[&Polygon]) -> Vec<u32> {
    let (lo, hi) = bounds(polygons.iter().map(|p| p.centroid()));
    let scale = DVec3::splat(1023.0) / (hi - lo).max(DVec3::splat(f64::MIN_POSITIVE));
    let code = |k: u32| {
        let cell = ((polygons[k as usize].centroid() - lo) * scale).as_uvec3();
        (0..10).fold(0_u32, |code, bit| {
            let of = |axis: u32, shift: u32| ((axis >> bit) & 1) << (3 * bit + shift);
            code | of(cell.x, 0) | of(cell.y, 1) | of(cell.z, 2)
        })
    };
    let mut order: Vec<(u32, u32)> = (0..polygons.len() as u32).map(|k| (code(k), k)).collect();
    order.sort_unstable();
    order.into_iter().map(|(_, k)| k).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use radiosity_gallery::boxes::faces;

    /// 125 unit boxes a distance 3 apart: every polygon is in one cluster with its own corners, and clusters are small.
    #[test]
    fn every_polygon_lies_with_its_neighbours_in_one_cluster() {
        let at = |k: usize| DVec3::new((k % 5) as f64, (k / 5 % 5) as f64, (k / 25) as f64) * 3.0;
        let loops = (0..125).flat_map(|k| faces(at(k), at(k) + 1.0, false));
        let polygons: Vec<Polygon> = loops.map(|face| Polygon::new(&face).unwrap()).collect();
        let clusters = Clusters::new(&polygons.iter().collect::<Vec<_>>());
        let mut seen = vec![0; polygons.len()];
        for cluster in &clusters.clusters {
            for member in &clusters.members[cluster.polygons.clone()] {
                seen[member.polygon as usize] += 1;
                let corner = |&place: &u32| {
                    DVec3::from_array(
                        [0, 1, 2].map(|axis| clusters.corners[axis][cluster.corners.start + place as usize]),
                    )
                };
                let corners: Vec<DVec3> = clusters.loops[member.loop_.clone()].iter().map(corner).collect();
                assert_eq!(corners, polygons[member.polygon as usize].vertices());
                assert!(corners.iter().all(|c| c.distance(cluster.centre) <= cluster.radius));
            }
        }
        assert_eq!(seen, vec![1; 750]);
        let mean = clusters.clusters.iter().map(|c| c.radius).sum::<f64>() / clusters.clusters.len() as f64;
        // The whole has radius 11.3. A ball of 32 of the 750 polygons would have 0.35 of it; the curve jumps now and then.
        assert!(mean < 0.6 * 11.3, "{mean}");
    }
}
