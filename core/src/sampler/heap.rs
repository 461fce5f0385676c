//! A binary heap in lent memory: the element for which `before` holds against all others comes first.

/// Moves the last element to its place.
pub(super) fn sift_up<T: Copy>(heap: &mut [T], before: fn(&T, &T) -> bool) {
    let mut i = heap.len().saturating_sub(1);
    while i > 0 && before(&heap[i], &heap[(i - 1) / 2]) {
        heap.swap(i, (i - 1) / 2);
        i = (i - 1) / 2;
    }
}

/// Takes the first element of a heap, which is then one shorter.
pub(super) fn pop<T: Copy>(heap: &mut [T], before: fn(&T, &T) -> bool) -> Option<T> {
    let last = heap.len().checked_sub(1)?;
    heap.swap(0, last);
    let top = heap[last];
    let heap = &mut heap[..last];
    let mut i = 0;
    loop {
        let (left, right) = (2 * i + 1, 2 * i + 2);
        let first = if right < last && before(&heap[right], &heap[left]) { right } else { left };
        if first >= last || !before(&heap[first], &heap[i]) {
            return Some(top);
        }
        heap.swap(i, first);
        i = first;
    }
}
