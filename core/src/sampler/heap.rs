//! A binary heap in a lent slice; the root is the element that `before` orders first.
//!
//! `heapless::BinaryHeap` has a capacity that is constant at compile time. The length of the lent slice is set at run time, and the slice
//! holds the leaves of the finished tree afterwards.

/// Moves the last element of `heap` up to its position.
pub(super) fn sift_up<T: Copy>(heap: &mut [T], before: fn(&T, &T) -> bool) {
    let mut i = heap.len().saturating_sub(1);
    while let Some((above, own)) = heap.split_at_mut_checked(i)
        && let (Some(parent), Some(child)) = (above.get_mut(i.wrapping_sub(1) / 2), own.first_mut())
        && before(child, parent)
    {
        core::mem::swap(parent, child);
        i = (i - 1) / 2;
    }
}

/// Removes the root of `heap`, moves it to the last element and restores the heap in the other elements.
pub(super) fn pop<T: Copy>(heap: &mut [T], before: fn(&T, &T) -> bool) -> Option<T> {
    let (last, heap) = heap.split_last_mut()?;
    let Some(first) = heap.first_mut() else { return Some(*last) };
    let top = core::mem::replace(first, *last);
    let mut i = 0;
    while let Some((above, below)) = heap.split_at_mut_checked(i + 1)
        && let Some(parent) = above.last_mut()
        && let Some(left) = below.get(i).copied()
    {
        // The children of i are 2 i + 1 and 2 i + 2: elements i and i + 1 of `below`.
        let right = below.get(i + 1).is_some_and(|right| before(right, &left));
        let Some(child) = below.get_mut(i + usize::from(right)).filter(|child| before(child, parent)) else {
            break;
        };
        core::mem::swap(parent, child);
        i += i + 1 + usize::from(right);
    }
    *last = top;
    Some(top)
}
