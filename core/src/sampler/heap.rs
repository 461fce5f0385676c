//! A binary heap in lent memory: the element for which `before` holds against all others comes first.
//!
//! `heapless::BinaryHeap` owns an array whose length is a constant, and its view is made of such an array alone; here the caller lends a
//! slice of a length known at run time, which holds the leaves of the finished tree afterwards.

/// Moves the last element to its place.
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

/// Takes the first element of a heap, which is then one shorter.
pub(super) fn pop<T: Copy>(heap: &mut [T], before: fn(&T, &T) -> bool) -> Option<T> {
    let (last, heap) = heap.split_last_mut()?;
    let Some(first) = heap.first_mut() else { return Some(*last) };
    let top = core::mem::replace(first, *last);
    let mut i = 0;
    while let Some((above, below)) = heap.split_at_mut_checked(i + 1)
        && let Some(parent) = above.last_mut()
        && let Some(left) = below.get(i).copied()
    {
        // The children of i are 2 i + 1 and 2 i + 2, i and i + 1 places on from here.
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
