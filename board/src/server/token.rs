//! The token: the secret that a client sends to be allowed to change settings and get pictures.

use crate::replacement;
use data_encoding::BASE64URL_NOPAD;
use rustix::fs::OFlags;
use std::fmt;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use subtle::ConstantTimeEq;

/// Number of random bytes in a generated token.
const RANDOM_BYTES: usize = 32;

/// Shortest accepted token, characters: ten random characters cannot be guessed over the network.
const LEAST: usize = 16;

/// Largest number of characters of an accepted token.
const MOST: usize = 256;

/// A secret text that no log, error or debug text contains.
#[derive(Clone)]
pub struct Token {
    secret: String,
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(not shown)")
    }
}

/// Reasons why a token file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TokenError {
    /// The token file cannot be read or created.
    #[error("token file {0}: found {1}, expected a readable file, or a folder in which it can be created")]
    File(PathBuf, std::io::Error),
    /// Other users may read the token file.
    #[error(
        "token file {0}: found permissions {1:04o}, expected 0600: others could read it (chmod 600 it and change the token)"
    )]
    Permissions(PathBuf, u32),
    /// The token file belongs to another user.
    #[error("token file {path}: found user {owner} as its owner, expected {user} or root")]
    Owner {
        /// Path of the token file.
        path: PathBuf,
        /// User id of the owner of the token file.
        owner: u32,
        /// Id of the user that runs the process.
        user: u32,
    },
    /// The token file does not contain exactly one token.
    #[error(
        "token file {0}: found something else, expected a file with one line of {LEAST} to {MOST} printable ASCII characters without spaces"
    )]
    Content(PathBuf),
    /// The operating system has no random numbers.
    #[error("found no random numbers ({0}), expected random numbers of the operating system")]
    Random(getrandom::Error),
}

/// Returns true if `file` is an empty regular file, as a power failure during its creation leaves.
fn is_empty_file(file: &File) -> std::io::Result<bool> {
    let about = file.metadata()?;
    Ok(about.is_file() && about.len() == 0)
}

/// A token that was read from a file, or created with it.
#[derive(Clone, Debug)]
pub struct LoadedToken {
    /// The token that the file contains.
    pub token: Token,
    /// True if the file was missing or empty and was created.
    pub is_new: bool,
}

impl Token {
    /// Creates a token from the random numbers of the operating system.
    ///
    /// # Errors
    /// [`TokenError::Random`] where the operating system provides no random numbers.
    pub fn random() -> Result<Self, TokenError> {
        let mut bytes = [0; RANDOM_BYTES];
        getrandom::fill(&mut bytes).map_err(TokenError::Random)?;
        Ok(Self { secret: BASE64URL_NOPAD.encode(&bytes) })
    }

    /// Reads the token in the file at `path`. Where the file is missing or empty, it is created with a random token
    /// (permissions 0600).
    ///
    /// # Errors
    /// [`TokenError`] where the token file cannot be used or created.
    pub fn load_or_make(path: &Path) -> Result<LoadedToken, TokenError> {
        let failed = |e| TokenError::File(path.into(), e);
        // Opening a FIFO for reading would block until another process opens it for writing.
        let opened =
            OpenOptions::new().read(true).custom_flags(OFlags::NONBLOCK.bits().cast_signed()).open(path);
        match opened {
            Ok(file) if is_empty_file(&file).map_err(failed)? => {
                Self::make(path, true).map(|token| LoadedToken { token, is_new: true })
            }
            Ok(file) => Self::load(path, file).map(|token| LoadedToken { token, is_new: false }),
            Err(e) if e.kind() == ErrorKind::NotFound => {
                Self::make(path, false).map(|token| LoadedToken { token, is_new: true })
            }
            Err(e) => Err(failed(e)),
        }
    }

    /// Writes a random token to a new file and renames the file to `path`: readers get the old or the new token, and no link is
    /// followed.
    fn make(path: &Path, replaces: bool) -> Result<Self, TokenError> {
        let failed = |e| TokenError::File(path.into(), e);
        let token = Self::random()?;
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut file = replacement::create(folder).map_err(failed)?;
        writeln!(file, "{}", token.secret).and_then(|()| file.as_file().sync_all()).map_err(failed)?;
        let named = if replaces { file.persist(path) } else { file.persist_noclobber(path) };
        named.map_err(|e| failed(e.error))?;
        Ok(token)
    }

    fn load(path: &Path, file: File) -> Result<Self, TokenError> {
        let failed = |e| TokenError::File(path.into(), e);
        let about = file.metadata().map_err(failed)?;
        if !about.is_file() {
            return Err(TokenError::Content(path.into()));
        }
        let (owner, user) = (about.uid(), rustix::process::geteuid().as_raw());
        if owner != user && owner != 0 {
            return Err(TokenError::Owner { path: path.into(), owner, user });
        }
        let mode = about.permissions().mode() & 0o7777;
        if mode & 0o077 != 0 {
            return Err(TokenError::Permissions(path.into(), mode));
        }
        let mut text = String::new();
        let read = file.take(MOST as u64 + 3).read_to_string(&mut text);
        read.map_err(|e| {
            if e.kind() == ErrorKind::InvalidData { TokenError::Content(path.into()) } else { failed(e) }
        })?;
        let secret = text.trim_end_matches(['\r', '\n']);
        let sound = (LEAST..=MOST).contains(&secret.len()) && secret.bytes().all(|b| b.is_ascii_graphic());
        if sound { Ok(Self { secret: secret.into() }) } else { Err(TokenError::Content(path.into())) }
    }

    /// Returns true if `candidate` is the secret. The duration of the comparison depends on the two lengths
    /// only.
    #[must_use]
    pub fn is(&self, candidate: &[u8]) -> bool {
        self.secret.as_bytes().ct_eq(candidate).into()
    }

    /// Returns the secret, for the Set-Cookie header.
    pub(super) fn reveal(&self) -> &str {
        &self.secret
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_created_once_and_readable_by_its_owner_alone() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("token");
        let LoadedToken { token: made, is_new: new } = Token::load_or_make(&path).expect("made");
        let mode = path.metadata().expect("a file").permissions().mode() & 0o7777;
        assert!(new && mode == 0o600, "{mode:o}");
        let LoadedToken { token: read, is_new: new } = Token::load_or_make(&path).expect("read");
        assert!(!new && read.is(made.secret.as_bytes()), "the same");
        assert_eq!(made.secret.len(), 43, "256 bits");
        assert!(!made.is(b"") && !made.is(&made.secret.as_bytes()[1..]) && !made.is(&[b'a'; 43]), "others");
        assert!(!format!("{made:?}").contains(&made.secret), "not shown");
    }

    #[test]
    fn an_empty_file_gets_a_token_and_a_link_in_its_place_is_not_followed() {
        let folder = tempfile::tempdir().expect("a folder");
        let (path, elsewhere) = (folder.path().join("token"), folder.path().join("elsewhere"));
        std::fs::write(&elsewhere, b"").expect("a file");
        std::os::unix::fs::symlink(&elsewhere, &path).expect("a link");
        let new = Token::load_or_make(&path).expect("made").is_new;
        assert!(new && path.symlink_metadata().expect("a file").is_file(), "a file of its own");
        assert_eq!(std::fs::read(&elsewhere).expect("a file"), b"", "untouched");
        assert_eq!(folder.path().read_dir().expect("a folder").count(), 2, "nothing is left beside them");
    }

    #[test]
    fn a_fifo_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("token");
        let made = std::process::Command::new("mkfifo").args(["-m", "600"]).arg(&path).status();
        assert!(made.expect("mkfifo").success(), "a FIFO");
        let refused = Token::load_or_make(&path).map(|_| ()).expect_err("refused").to_string();
        assert!(refused.contains("expected a file with one line"), "{refused}");
    }

    #[test]
    fn files_readable_by_others_or_without_a_token_are_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("token");
        let refused = |content: &[u8], mode: u32| {
            std::fs::write(&path, content).expect("a file");
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).expect("permissions");
            Token::load_or_make(&path).map(|_| ()).expect_err("refused").to_string()
        };
        let good = b"0123456789abcdef\n";
        assert!(refused(good, 0o644).contains("permissions 0644, expected 0600"), "readable by all");
        assert!(refused(good, 0o620).contains("0620"), "writable by the group");
        for content in [
            &b"short\n"[..],
            b"with a space in its midst\n",
            b"two lines, each\nof them long",
            b"\xff\xfe0123456789abcdef",
            &[b'a'; 300],
        ] {
            assert!(refused(content, 0o600).contains("expected a file with one line"), "{content:?}");
        }
        let nowhere = Token::load_or_make(&folder.path().join("no/such/folder"));
        assert!(nowhere.expect_err("refused").to_string().contains("no/such/folder"), "named");
    }
}
