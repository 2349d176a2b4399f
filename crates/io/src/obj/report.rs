//! What was met in a scene file.

/// A texture named by a material and left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texture {
    /// Name of the material.
    pub material: String,
    /// The keyword: `map_Kd`, `bump`, …
    pub key: String,
    /// The file as the material names it.
    pub file: String,
    /// Whether the file is there, beside the material library.
    pub found: bool,
}

/// Counts of everything in a file that is not plain, as met, before anything was mended.
///
/// Faces are those of the `f` lines, in file order; face k is surface k of the scene. Materials are those that a face
/// uses; a material that no face uses is checked for values that are no colours and otherwise left alone.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImportReport {
    /// `v` lines.
    pub vertices: usize,
    /// `f` lines.
    pub faces: usize,
    /// Faces of 3 corners.
    pub triangles: usize,
    /// Faces of 4 corners.
    pub quads: usize,
    /// Faces of 5 corners and more.
    pub polygons: usize,
    /// Corners of the face that has most.
    pub most_corners: usize,
    /// Faces that are planar but not convex, split into triangles inside.
    pub concave_split: usize,
    /// Faces whose corners do not lie in one plane, split into triangles inside.
    pub non_planar_split: usize,
    /// Faces without an area (fewer than three distinct corners included): dropped, their index stays.
    pub zero_area_dropped: usize,
    /// Faces with the same corners as an earlier one, either way round.
    pub duplicate_faces: usize,
    /// Those among the duplicates that turn the other side of a sheet: kept.
    pub two_sided_sheets: usize,
    /// Those among the duplicates that lie the same way round as an earlier face: dropped, their index stays.
    pub repeated_dropped: usize,
    /// Edges that belong to one face only, edges told apart by the coordinates of their ends.
    pub open_edges: usize,
    /// Edges of two faces and more that do not run as often one way as the other: neighbours turned inside out.
    pub turned_edges: usize,
    /// `l` lines, left out.
    pub line_elements: usize,
    /// `p` lines, left out.
    pub point_elements: usize,
    /// Other lines that are not understood or not supported (curves, free-form surfaces), left out.
    pub other_lines: usize,
    /// Files named by `mtllib` that are not there.
    pub libraries_not_found: Vec<String>,
    /// Faces without a material of any name: no `usemtl` before them, or an empty or `(null)` one.
    pub faces_without_material: usize,
    /// Materials that faces name but no library defines.
    pub materials_missing: Vec<String>,
    /// Faces of such materials.
    pub faces_of_missing_materials: usize,
    /// Materials without `Kd`.
    pub materials_without_kd: Vec<String>,
    /// Materials with a component of `Kd` of 1 or more.
    pub kd_at_least_1: Vec<String>,
    /// Materials with a component of `Kd` + `Ks` above 1.
    pub kd_ks_above_1: Vec<String>,
    /// Materials whose reflectance was scaled down to the clamp.
    pub clamped: Vec<String>,
    /// Textures, left out.
    pub textures: Vec<Texture>,
    /// Materials with a specular part, as `name: Ks 0.2, Ns 50`.
    pub specular: Vec<String>,
    /// Materials that let light through without refracting it, which is left out, as `name: d 0.4`.
    pub transparent: Vec<String>,
    /// One sentence for everything above that changes the answer or is left out.
    pub warnings: Vec<String>,
}

impl ImportReport {
    /// Whether every edge of the faces kept meets another one, running the other way: a necessary sign of a closed scene.
    pub fn closed(&self) -> bool {
        self.open_edges == 0 && self.turned_edges == 0
    }

    /// Turns the counts into sentences, behind those already there; `specular`: specular parts count.
    pub(crate) fn warn(&mut self, specular: bool) {
        let missing_files = self.textures.iter().filter(|t| !t.found).count();
        let counted = [
            (self.zero_area_dropped, "of no area dropped; their rows of form factors are 0"),
            (
                self.repeated_dropped,
                "dropped that repeat an earlier face the same way round; their rows of form factors are 0",
            ),
            (self.concave_split, "that are not convex split into triangles; each stays one surface"),
            (self.non_planar_split, "that are not planar split into triangles; each stays one surface"),
            (self.faces_without_material, "without a material take the default reflectance"),
        ];
        for (count, what) in counted.into_iter().filter(|(count, _)| *count > 0) {
            self.warnings.push(format!("{} {what}", plural(count, "face")));
        }
        if self.two_sided_sheets > 0 {
            self.warnings.push(format!(
                "{} given twice, once each way round; both sides are kept",
                plural(self.two_sided_sheets, "sheet")
            ));
        }
        for (count, what) in [(self.line_elements, "l"), (self.point_elements, "p")] {
            if count > 0 {
                self.warnings
                    .push(format!("{} left out: they have no area", plural(count, &format!("'{what}' element"))));
            }
        }
        let specular_left_out = if specular { String::new() } else { self.specular.join("; ") };
        let listed = [
            (self.libraries_not_found.join(", "), "material libraries not found"),
            (self.materials_missing.join(", "), "materials not defined, replaced by the default reflectance"),
            (self.materials_without_kd.join(", "), "materials without Kd reflect nothing or the default"),
            (self.clamped.join(", "), "materials scaled down to the clamped reflectance"),
            (specular_left_out, "specular parts count only where specular bounces are asked for"),
            (self.transparent.join("; "), "transparent parts left out"),
        ];
        for (names, what) in listed.into_iter().filter(|(names, _)| !names.is_empty()) {
            self.warnings.push(format!("{what}: {names}"));
        }
        if !self.textures.is_empty() {
            let files: Vec<_> = self.textures.iter().map(|t| format!("{} {} {}", t.material, t.key, t.file)).collect();
            let found =
                if missing_files == 0 { String::new() } else { format!(" ({missing_files} of them not found)") };
            self.warnings.push(format!("textures left out{found}: {}", files.join(", ")));
        }
    }
}

/// `1 face`, `2 faces`.
fn plural(count: usize, noun: &str) -> String {
    if count == 1 { format!("1 {noun}") } else { format!("{count} {noun}s") }
}
