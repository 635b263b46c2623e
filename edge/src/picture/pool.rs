//! Reused buffers: a new buffer of 3 MB per picture costs the kernel as much as a crop.

use std::io::Read;
use std::ops::Deref;
use std::sync::{Arc, Mutex, PoisonError};

/// Most unused buffers kept: as many as are in use between a source and its crops.
const KEPT: usize = 4;

/// The buffers of one source.
#[derive(Debug, Clone, Default)]
pub struct BufferPool(Arc<Mutex<Vec<Vec<u8>>>>);

impl BufferPool {
    /// Reads this many bytes into a buffer; fewer if the reader ends or fails.
    pub fn read(&self, reader: &mut impl Read, n_bytes: usize) -> PooledBytes {
        self.write(n_bytes, |bytes| {
            reader.take(n_bytes as u64).read_to_end(bytes).ok();
        })
    }

    /// An empty buffer with room for this many bytes, filled by `write`.
    pub fn write(&self, n_bytes: usize, write: impl FnOnce(&mut Vec<u8>)) -> PooledBytes {
        let kept = self.kept().pop();
        let mut bytes = kept.unwrap_or_default();
        bytes.clear();
        bytes.reserve_exact(n_bytes);
        write(&mut bytes);
        PooledBytes {
            bytes,
            pool: self.clone(),
        }
    }

    fn kept(&self) -> std::sync::MutexGuard<'_, Vec<Vec<u8>>> {
        // Buffers remain valid after a panic.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Bytes that return their buffer when dropped.
#[derive(Debug, Clone)]
pub struct PooledBytes {
    bytes: Vec<u8>,
    pool: BufferPool,
}

impl From<Vec<u8>> for PooledBytes {
    fn from(bytes: Vec<u8>) -> Self {
        Self {
            bytes,
            pool: BufferPool::default(),
        }
    }
}

impl Deref for PooledBytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.bytes
    }
}

impl PartialEq for PooledBytes {
    fn eq(&self, other: &Self) -> bool {
        self.bytes == other.bytes
    }
}

impl Drop for PooledBytes {
    fn drop(&mut self) {
        let mut kept = self.pool.kept();
        if kept.len() < KEPT {
            kept.push(std::mem::take(&mut self.bytes));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_buffer_is_used_again_once_its_picture_is_gone() {
        let pool = BufferPool::default();
        let first = pool.read(&mut &[1u8, 2, 3][..], 3);
        let second = pool.read(&mut &[4u8, 5, 6][..], 3);
        assert_eq!((&first[..], &second[..]), (&[1, 2, 3][..], &[4, 5, 6][..]));
        let place = first.as_ptr();
        drop(first);
        let third = pool.read(&mut &[7u8, 8][..], 3);
        assert_eq!(
            (&third[..], third.as_ptr(), &second[..]),
            (&[7, 8][..], place, &[4, 5, 6][..])
        );
    }
}
