//! Opening of device nodes, queries of their capabilities, and errors of their requests.

use super::{Call, CameraError, Kernel, Node, abi, persist};
use rustix::io::Errno;
use std::path::Path;

/// Opens the device node at `path`.
///
/// # Errors
/// [`CameraError::Gone`] for a missing node, else [`CameraError::Failed`] with the kernel's error.
pub(super) fn open(kernel: &mut dyn Kernel, path: &Path) -> Result<Box<dyn Node>, CameraError> {
    persist(|| kernel.open(path)).map_err(|e| match e {
        Errno::NOENT | Errno::NODEV | Errno::NXIO => CameraError::Gone(path.into()),
        Errno::ACCESS | Errno::PERM => {
            failed(path, "open", e, "a device that this user may open (is the user in the group video?)")
        }
        _ => failed(path, "open", e, "a camera that no other program holds"),
    })
}

pub(super) fn failed(
    path: &Path,
    operation: &'static str,
    errno: Errno,
    expected: &'static str,
) -> CameraError {
    if [Errno::NODEV, Errno::NXIO].contains(&errno) {
        return CameraError::Gone(path.into());
    }
    CameraError::Failed { path: path.into(), operation, errno: errno.to_string(), expected }
}

pub(super) fn capability(node: &mut dyn Node, path: &Path) -> Result<abi::Capability, CameraError> {
    let mut caps = abi::Capability::default();
    persist(|| node.call(Call::QueryCapability(&mut caps)))
        .map_err(|e| failed(path, "QUERYCAP", e, "a V4L2 device"))?;
    Ok(caps)
}

/// Returns whether a node captures single-planar pictures and supports streaming.
pub(super) fn captures(caps: &abi::Capability) -> bool {
    let own = caps.capabilities & abi::CAP_DEVICE_CAPS != 0;
    let caps = if own { caps.device_caps } else { caps.capabilities };
    let needed = abi::CAP_CAPTURE | abi::CAP_STREAMING;
    caps & needed == needed
}
