//! Enumeration, reading and writing of a camera's controls, of any class, one control per request.

use super::{Call, Node, abi, persist, text};
use rustix::io::Errno;

/// Largest number of controls that are read from a driver; vivid has about a hundred.
const MAX_CONTROLS: usize = 1024;

/// Description of a control, as the driver returns it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Info {
    /// Number of the control.
    pub id: u32,
    /// `V4L2_CTRL_TYPE_...`, including types that have no constant here.
    pub kind: u32,
    /// Name of the control, which may differ between kernels.
    pub name: String,
    /// Least value of the control.
    pub minimum: i64,
    /// Largest value of the control.
    pub maximum: i64,
    /// Step between two values of the control, at least 1.
    pub step: i64,
    /// Value of the control at power-on.
    pub default: i64,
    /// Flags of the control, `V4L2_CTRL_FLAG_*`.
    pub flags: u32,
}

impl Info {
    fn of(d: &abi::ControlDescription) -> Self {
        let step = i64::try_from(d.step).unwrap_or(i64::MAX).max(1);
        let (minimum, maximum) = (d.minimum.min(d.maximum), d.maximum.max(d.minimum));
        Self {
            id: d.id,
            kind: d.kind,
            name: text(&d.name),
            minimum,
            maximum,
            step,
            default: d.default,
            flags: d.flags,
        }
    }

    /// Returns whether the control is a number that can be set, at once or after an automatic mode is switched off.
    #[must_use]
    pub fn is_settable(&self) -> bool {
        let number = [
            abi::TYPE_INTEGER,
            abi::TYPE_BOOLEAN,
            abi::TYPE_MENU,
            abi::TYPE_INTEGER64,
            abi::TYPE_INTEGER_MENU,
        ];
        number.contains(&self.kind) && self.flags & (abi::CONTROL_DISABLED | abi::CONTROL_READ_ONLY) == 0
    }

    /// Returns the value of the control that is nearest to `value`.
    #[must_use]
    pub fn nearest(&self, value: i64) -> i64 {
        let [value, least, most, step] =
            [value.clamp(self.minimum, self.maximum), self.minimum, self.maximum, self.step].map(i128::from);
        let nearest = least + (value - least + step / 2) / step * step;
        i64::try_from(nearest.min(most)).unwrap_or(self.maximum)
    }
}

/// Returns the description of control `id`, if the node has it.
pub fn find(node: &mut dyn Node, id: u32) -> Option<Info> {
    let mut d = abi::ControlDescription { id, ..Default::default() };
    persist(|| node.call(Call::QueryControl(&mut d))).ok()?;
    (d.flags & abi::CONTROL_DISABLED == 0).then(|| Info::of(&d))
}

/// Returns the descriptions of all controls of a node.
pub fn all(node: &mut dyn Node) -> Vec<Info> {
    let mut found: Vec<Info> = Vec::new();
    let mut last = 0;
    while found.len() < MAX_CONTROLS {
        let mut d = abi::ControlDescription { id: last | abi::NEXT_CONTROL, ..Default::default() };
        // Driver control numbers that do not increase would otherwise cause an endless loop.
        if persist(|| node.call(Call::QueryControl(&mut d))).is_err() || d.id <= last {
            break;
        }
        last = d.id;
        if d.flags & abi::CONTROL_DISABLED == 0 {
            found.push(Info::of(&d));
        }
    }
    found
}

/// Returns whether menu control `id` has an item with the number `index`; the numbers of a menu's items need
/// not be contiguous.
pub fn has_item(node: &mut dyn Node, id: u32, index: i64) -> bool {
    let Ok(index) = u32::try_from(index) else { return false };
    let mut item = abi::MenuItem { id, index, ..Default::default() };
    persist(|| node.call(Call::QueryMenu(&mut item))).is_ok()
}

/// Reads the value of a control.
///
/// # Errors
/// The error of the kernel's request.
pub fn value(node: &mut dyn Node, info: &Info) -> Result<i64, Errno> {
    let mut control = abi::Control { id: info.id, ..Default::default() };
    persist(|| node.call(Call::GetControl(&mut control)))?;
    let [low, high] = control.value;
    if info.kind == abi::TYPE_INTEGER64 {
        let (mut bytes, words) = ([0; 8], [low.to_ne_bytes(), high.to_ne_bytes()]);
        bytes[..4].copy_from_slice(&words[0]);
        bytes[4..].copy_from_slice(&words[1]);
        return Ok(i64::from_ne_bytes(bytes));
    }
    Ok(i64::from(low.cast_signed()))
}

/// Sets the value of a control.
///
/// # Errors
/// The error of the kernel's request; EACCES while an automatic mode holds the control.
pub fn set(node: &mut dyn Node, info: &Info, value: i64) -> Result<(), Errno> {
    let bytes = value.to_ne_bytes();
    let word = |at: usize| u32::from_ne_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    let words = if info.kind == abi::TYPE_INTEGER64 {
        [word(0), word(4)]
    } else {
        let narrow = i32::try_from(value).map_err(|_| Errno::RANGE)?;
        [narrow.cast_unsigned(), 0]
    };
    let mut control = abi::Control { id: info.id, value: words, ..Default::default() };
    persist(|| node.call(Call::SetControl(&mut control)))
}

/// Sets control `id`, if the node has it, to `wanted` and returns the value that is read back.
pub fn settle(node: &mut dyn Node, id: u32, wanted: i64) -> Option<i64> {
    let info = find(node, id).filter(Info::is_settable)?;
    let _ = set(node, &info, info.nearest(wanted));
    value(node, &info).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_rounded_to_a_step_within_the_range() {
        let info = |minimum, maximum, step| Info {
            id: 1,
            kind: abi::TYPE_INTEGER,
            name: String::new(),
            minimum,
            maximum,
            step,
            default: 0,
            flags: 0,
        };
        let found = [-5, 3, 4, 8, 99].map(|v| info(3, 28, 10).nearest(v));
        assert_eq!(found, [3, 3, 3, 13, 28], "steps count from the least value, the largest is one too");
        assert_eq!(info(i64::MIN, i64::MAX, 1).nearest(7), 7, "no overflow");
    }
}
