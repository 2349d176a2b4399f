//! A perspective camera.

use glam::DVec3;

/// A pinhole camera: where it stands, where it looks, how wide and onto how many pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    eye: DVec3,
    /// Unit vectors to the right, up and forward.
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    /// Half the height of the picture at distance 1.
    half_height: f64,
    width: u32,
    height: u32,
}

/// Why there is no such camera.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
    /// A coordinate that is no number.
    #[error("eye {eye}, look-at {look_at} and up {up} must be finite")]
    NotFinite {
        /// Place of the camera.
        eye: DVec3,
        /// The point looked at.
        look_at: DVec3,
        /// Upward direction.
        up: DVec3,
    },
    /// No direction to look in.
    #[error("the camera at {eye} looks at itself; choose another point to look at")]
    NoDirection {
        /// Place of the camera.
        eye: DVec3,
    },
    /// No way to tell where up is.
    #[error("up {up} is zero or runs along the view; choose another direction")]
    NoUp {
        /// Upward direction given.
        up: DVec3,
    },
    /// A field of view that no plane picture has.
    #[error("the field of view is {degrees}°; it must lie between 0 and 180")]
    FieldOfView {
        /// Angle given.
        degrees: f64,
    },
    /// No pixel.
    #[error("a picture of {width} × {height} pixels shows nothing; ask for at least one pixel")]
    Size {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
}

impl Camera {
    /// A camera at `eye` that sees `look_at` in the middle of its picture and `up` upwards.
    ///
    /// `fov` is the angle between the lower and the upper edge of the picture in degrees; pixels are square.
    ///
    /// # Errors
    ///
    /// [`CameraError`] if these describe no camera.
    pub fn new(eye: DVec3, look_at: DVec3, up: DVec3, fov: f64, width: u32, height: u32) -> Result<Self, CameraError> {
        if !(eye.is_finite() && look_at.is_finite() && up.is_finite()) {
            return Err(CameraError::NotFinite { eye, look_at, up });
        }
        if !(fov > 0.0 && fov < 180.0) {
            return Err(CameraError::FieldOfView { degrees: fov });
        }
        if width == 0 || height == 0 {
            return Err(CameraError::Size { width, height });
        }
        let forward = (look_at - eye).try_normalize().ok_or(CameraError::NoDirection { eye })?;
        // Parallel to rounding is parallel: the picture would turn with the last digit.
        let right = up.try_normalize().map(|up| forward.cross(up)).filter(|r| r.length() > 1e-9);
        let right = right.and_then(DVec3::try_normalize).ok_or(CameraError::NoUp { up })?;
        let half_height = (0.5 * fov.to_radians()).tan();
        Ok(Self { eye, right, up: right.cross(forward), forward, half_height, width, height })
    }

    /// A camera that looks along `direction` at the whole of the box from `lo` to `hi`, standing outside of it.
    ///
    /// # Errors
    ///
    /// [`CameraError`] as [`Self::new`].
    pub fn framing(
        (lo, hi): (DVec3, DVec3),
        direction: DVec3,
        up: DVec3,
        fov: f64,
        width: u32,
        height: u32,
    ) -> Result<Self, CameraError> {
        let (middle, radius) = (lo + (hi - lo) * 0.5, 0.5 * (hi - lo).length());
        // The sphere around the box touches the edges of the narrower field of view.
        let aspect = f64::from(width) / f64::from(height.max(1));
        let half = ((0.5 * fov.to_radians()).tan() * aspect.min(1.0)).atan();
        Self::new(middle - direction.normalize_or_zero() * (radius / half.sin()), middle, up, fov, width, height)
    }

    /// Where the camera stands.
    pub fn eye(&self) -> DVec3 {
        self.eye
    }

    /// Pixels in a row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Unit direction through the point (x, y) of the picture in pixels, from its upper left corner.
    ///
    /// The middle of pixel (i, j) is (i + ½, j + ½).
    pub fn direction(&self, x: f64, y: f64) -> DVec3 {
        let (width, height) = (f64::from(self.width), f64::from(self.height));
        let pixel = 2.0 * self.half_height / height;
        let (dx, dy) = ((x - 0.5 * width) * pixel, (0.5 * height - y) * pixel);
        (self.forward + self.right * dx + self.up * dy).normalize()
    }

    /// The ends in pixels, from the upper left corner, of what lies before the camera of a segment; `None` if nothing does.
    ///
    /// What begins beside or behind the eye is cut at 10⁻⁶ of its length before it.
    pub fn project(&self, a: DVec3, b: DVec3) -> Option<[[f64; 2]; 2]> {
        let [a, b] = [a, b].map(|p| p - self.eye);
        let (da, db) = (a.dot(self.forward), b.dot(self.forward));
        let near = 1e-6 * (b - a).length();
        if da.max(db) <= near {
            return None;
        }
        let cut =
            |p: DVec3, dp: f64, q: DVec3, dq: f64| if dp < near { p + (q - p) * ((near - dp) / (dq - dp)) } else { p };
        let pixel = 2.0 * self.half_height / f64::from(self.height);
        Some([cut(a, da, b, db), cut(b, db, a, da)].map(|p| {
            let scale = 1.0 / (p.dot(self.forward) * pixel);
            [
                0.5 * f64::from(self.width) + p.dot(self.right) * scale,
                0.5 * f64::from(self.height) - p.dot(self.up) * scale,
            ]
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera::new(DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.0, 2.0, -7.0), DVec3::new(0.0, 3.0, 1.0), 90.0, 300, 200)
            .unwrap()
    }

    #[test]
    fn the_middle_looks_forward_and_the_edges_45_degrees_up_and_down() {
        let camera = camera();
        let near = |a: DVec3, b: DVec3| assert!((a - b.normalize()).length() < 1e-15, "{a} {b}");
        near(camera.direction(150.0, 100.0), -DVec3::Z);
        near(camera.direction(150.0, 0.0), DVec3::new(0.0, 1.0, -1.0));
        near(camera.direction(150.0, 200.0), DVec3::new(0.0, -1.0, -1.0));
        // Square pixels: 300 wide at 200 high.
        near(camera.direction(300.0, 100.0), DVec3::new(1.5, 0.0, -1.0));
    }

    /// What is seen in the direction of a place of the picture is projected there; a segment from behind the eye goes on beyond the picture.
    #[test]
    fn segments_are_projected_to_where_they_are_seen() {
        let camera = camera();
        let at = |x, y, distance| camera.eye() + camera.direction(x, y) * distance;
        let [a, b] = camera.project(at(40.0, 170.5, 3.0), at(310.0, -20.0, 0.7)).unwrap();
        let near = |a: [f64; 2], b: [f64; 2]| assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-9, "{a:?} {b:?}");
        near(a, [40.0, 170.5]);
        near(b, [310.0, -20.0]);
        let behind = at(150.0, 100.0, -5.0);
        let [a, b] = camera.project(behind + DVec3::X, at(40.0, 100.0, 3.0)).unwrap();
        near(b, [40.0, 100.0]);
        assert!(a[0] < -1e4 && (a[1] - 100.0).abs() < -1e-6 * a[0], "{a:?}");
        assert_eq!(camera.project(behind, behind + DVec3::Y), None);
    }

    #[test]
    fn a_framed_box_touches_the_edges_of_the_picture_and_no_more() {
        let (lo, hi) = (DVec3::new(-1.0, 0.0, 2.0), DVec3::new(2.0, 5.0, 4.0));
        let camera = Camera::framing((lo, hi), DVec3::NEG_Z, DVec3::Y, 40.0, 100, 200).unwrap();
        let corners = (0..8).map(|k| DVec3::select(glam::BVec3::new(k & 1 > 0, k & 2 > 0, k & 4 > 0), lo, hi));
        let slope = (20.0_f64).to_radians().tan();
        for d in corners.map(|c| c - camera.eye()) {
            assert!(d.z < 0.0 && d.y.abs() < -d.z * slope && d.x.abs() < -d.z * slope * 0.5);
        }
    }

    #[test]
    fn cameras_that_see_nothing_are_refused() {
        let new = |eye, up, fov, width| Camera::new(eye, DVec3::ZERO, up, fov, width, 1);
        assert!(matches!(new(DVec3::ZERO, DVec3::Y, 40.0, 1), Err(CameraError::NoDirection { .. })));
        assert!(matches!(new(DVec3::Y, DVec3::Y * 2.0, 40.0, 1), Err(CameraError::NoUp { .. })));
        assert!(matches!(new(DVec3::X, DVec3::ZERO, 40.0, 1), Err(CameraError::NoUp { .. })));
        assert!(matches!(new(DVec3::X, DVec3::Y, 180.0, 1), Err(CameraError::FieldOfView { .. })));
        assert!(matches!(new(DVec3::X, DVec3::Y, f64::NAN, 1), Err(CameraError::FieldOfView { .. })));
        assert!(matches!(new(DVec3::X, DVec3::Y, 40.0, 0), Err(CameraError::Size { .. })));
        assert!(matches!(new(DVec3::NAN, DVec3::Y, 40.0, 1), Err(CameraError::NotFinite { .. })));
    }
}
