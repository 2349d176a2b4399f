//! Runs the built program in a folder of its own.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A folder for one test, emptied when the test begins and removed when it succeeds.
pub struct Folder(PathBuf);

/// What a run of the program gave.
pub struct Ran {
    /// Exit code.
    pub code: i32,
    /// Standard output.
    pub stdout: String,
    /// Standard error.
    pub stderr: String,
}

impl Folder {
    /// A new folder for the test called `name`.
    pub fn new(name: &str) -> Self {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    /// Writes a file.
    pub fn write(&self, name: &str, text: &str) {
        fs::write(self.0.join(name), text).unwrap();
    }

    /// Reads a file; bytes that are no text are replaced.
    #[allow(dead_code)] // each test file reads what it needs
    pub fn read(&self, name: &str) -> String {
        let bytes = fs::read(self.0.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        String::from_utf8_lossy(&bytes).into_owned()
    }

    /// Reads a file that is no text.
    #[allow(dead_code)] // each test file reads what it needs
    pub fn bytes(&self, name: &str) -> Vec<u8> {
        fs::read(self.0.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// Names of all files, sorted.
    #[allow(dead_code)] // each test file uses what it needs
    pub fn files(&self) -> Vec<String> {
        let names = fs::read_dir(&self.0).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let mut names: Vec<String> = names.collect();
        names.sort();
        names
    }

    /// Runs the program in this folder with arguments separated by blanks.
    pub fn run(&self, arguments: &str) -> Ran {
        let output = Command::new(env!("CARGO_BIN_EXE_radiosity"))
            .args(arguments.split_whitespace())
            .current_dir(&self.0)
            .output()
            .unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        Ran { code: output.status.code().unwrap(), stdout: text(output.stdout), stderr: text(output.stderr) }
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            let _ = fs::remove_dir_all(&self.0);
        }
    }
}

/// Opposed unit squares a distance 1 apart, the upper one a lamp, as OBJ with `squares.mtl`.
#[allow(dead_code)] // each test file uses the scenes it needs
pub const SQUARES: &str = "mtllib squares.mtl
v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0
v 0 0 1\nv 0 1 1\nv 1 1 1\nv 1 0 1
usemtl grey\nf 1 2 3 4
usemtl lamp\nf 5 6 7 8
";

/// Materials of [`SQUARES`].
#[allow(dead_code)] // each test file uses the scenes it needs
pub const SQUARES_MTL: &str = "newmtl grey\nKd 0.5 0.4 0.3\nnewmtl lamp\nKd 0 0 0\nKe 2 3 4\n";

/// The unit cube from inside, its ceiling a lamp that reflects nothing, as OBJ with `cube.mtl`.
#[allow(dead_code)] // each test file uses the scenes it needs
pub const CUBE: &str = "mtllib cube.mtl
v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1
usemtl grey\nf 1 2 3 4\nf 1 4 8 5\nf 1 5 6 2\nf 7 3 2 6\nf 7 8 4 3
usemtl lamp\nf 7 6 5 8
";

/// Materials of [`CUBE`].
#[allow(dead_code)] // each test file uses the scenes it needs
pub const CUBE_MTL: &str = "newmtl grey\nKd 0.5 0.4 0.3\nnewmtl lamp\nKd 0 0 0\nKe 2 3 4\n";
