//! The scene's large buffers: what lies where in them, and what has yet to get there.
//!
//! A block is uploaded once and stays while any wanted scene shows it. New ones go to free ranges of the buffers, which the
//! frames that are being shown do not read. Where there is no room, or far too much, all blocks move to a buffer of another size,
//! and the old one serves until the new one is whole. All of this is done in slices of a few megabytes, one a frame.

use std::collections::{HashMap, HashSet, VecDeque};
use std::sync::Arc;

use lantern_gpu::{Buffer, BufferKind, CopyRegion, Device, GpuError, Recorder, Submission};

use crate::arena::Arena;
use crate::block::{Block, COLUMNS, Column, Key, SPACES};
use crate::loads::Ways;

/// Bytes of the smallest buffer: of an empty one there is nothing to bind.
pub(crate) const SMALLEST: u64 = 256;

/// Slices that may be on their way at once; each has a staging buffer.
const FLYING: usize = 2;

/// The buffers of a space and what is free in them.
#[derive(Clone)]
struct Space {
    /// By column.
    buffers: Vec<Arc<Buffer>>,
    arena: Arena,
}

impl Space {
    fn new(device: &Arc<Device>, columns: &[Column], elements: u64) -> Result<Self, GpuError> {
        let buffer = |c: &Column| {
            let smallest = SMALLEST.div_ceil(c.element_bytes) * c.element_bytes;
            Buffer::new(device, c.name, BufferKind::Texel(c.format), (elements * c.element_bytes).max(smallest))
        };
        Ok(Self { buffers: columns.iter().map(buffer).collect::<Result<_, _>>()?, arena: Arena::new(elements) })
    }
}

/// A block's share of a space.
#[derive(Clone, Copy, Default)]
struct Share {
    /// First element in the space's buffers.
    first: Option<u64>,
    /// Whether everything has been written there.
    whole: bool,
    /// First element in the buffers that the space moves to.
    next: Option<u64>,
}

#[derive(Clone)]
struct Held {
    block: Block,
    shares: [Share; SPACES],
}

/// Elements of a block on their way to one column of a space.
#[derive(Clone, Copy)]
struct Job {
    key: Key,
    space: usize,
    column: usize,
    /// Elements that were recorded.
    done: u64,
    /// Whether they come from the space's old buffers rather than from the host.
    moves: bool,
}

/// Everything that changes together, so that a refusal leaves all as it was.
#[derive(Clone)]
struct State {
    spaces: Vec<Space>,
    /// What a space moves to.
    next: Vec<Option<Space>>,
    held: HashMap<Key, Held>,
    jobs: VecDeque<Job>,
}

/// See the module.
pub(crate) struct Store {
    device: Arc<Device>,
    /// What the buffers can be read through.
    ways: Ways,
    state: State,
    flying: VecDeque<Submission>,
}

/// What [`Store::advance`] brought about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Advanced {
    /// Blocks lie elsewhere, in other buffers.
    pub(crate) moved: bool,
    /// Bytes that were sent on their way.
    pub(crate) bytes: u64,
}

/// Elements of a buffer that shall hold `needed`: an eighth more, so that many small additions move everything but rarely.
fn roomy(device: &Device, ways: &Ways, columns: &[Column], needed: u64) -> u64 {
    let most = |c: &Column| {
        let room = ways.room(c.format, needed * c.element_bytes);
        room.min(device.limits().max_buffer_bytes) / c.element_bytes
    };
    let limit = columns.iter().map(most).min().unwrap_or(needed);
    // What passes the limit itself is refused by name when the buffer is made.
    (needed + needed / 8).min(limit).max(needed)
}

impl Store {
    /// Empty.
    pub(crate) fn new(device: &Arc<Device>, ways: Ways) -> Result<Self, GpuError> {
        let spaces = COLUMNS.iter().map(|columns| Space::new(device, columns, 0)).collect::<Result<_, _>>()?;
        let state = State { spaces, next: vec![None; SPACES], held: HashMap::new(), jobs: VecDeque::new() };
        Ok(Self { device: device.clone(), ways, state, flying: VecDeque::new() })
    }

    /// Makes these the blocks that are to be held: lets go of all others, and queues what is not there yet.
    ///
    /// # Errors
    /// A buffer that the device cannot make, or cannot read together with the others; then nothing has changed.
    pub(crate) fn want(&mut self, wanted: impl Iterator<Item = Block>) -> Result<(), GpuError> {
        // Each once, in the scene's order, so that the same edits always lead to the same layout.
        let mut seen = HashSet::new();
        let wanted: Vec<Block> = wanted.filter(|block| seen.insert(block.key())).collect();
        if wanted.len() == self.state.held.len() && wanted.iter().all(|b| self.state.held.contains_key(&b.key())) {
            return Ok(());
        }
        let mut state = self.state.clone();
        state.drop_all_but(&seen);
        for block in &wanted {
            let new = || Held { block: block.clone(), shares: [Share::default(); SPACES] };
            state.held.entry(block.key()).or_insert_with(new);
        }
        for space in 0..SPACES {
            state.fit(&self.device, &self.ways, space, &wanted)?;
        }
        let next = state.spaces.iter().zip(&state.next).map(|(now, next)| next.as_ref().unwrap_or(now));
        self.ways.through(next.flat_map(|space| &space.buffers))?;
        self.state = state;
        Ok(())
    }

    /// Whether these are there, every byte recorded, for frames that are recorded from now on.
    pub(crate) fn has(&self, mut blocks: impl Iterator<Item = Block>) -> bool {
        blocks.all(|block| {
            let held = self.state.held.get(&block.key());
            held.is_some_and(|held| held.shares.iter().all(|share| share.whole))
        })
    }

    /// Whether anything has yet to be sent, or to arrive: what its slice uses is held until then.
    pub(crate) fn is_busy(&self) -> bool {
        !self.state.jobs.is_empty() || !self.flying.is_empty()
    }

    /// The first element of a block that is there.
    pub(crate) fn first(&self, block: &Block, space: usize) -> u32 {
        let held = self.state.held.get(&block.key());
        held.and_then(|held| held.shares[space].first).unwrap_or(0) as u32
    }

    /// The buffers that frames read, by name.
    pub(crate) fn buffers(&self) -> impl Iterator<Item = (&'static str, &Arc<Buffer>)> {
        let of_space = |(columns, space): (&&'static [Column], _)| {
            let space: &Space = space;
            columns.iter().map(|c| c.name).zip(&space.buffers).collect::<Vec<_>>()
        };
        COLUMNS.iter().zip(&self.state.spaces).flat_map(of_space)
    }

    /// Sends at most about `budget` bytes on their way, and takes over what is complete.
    ///
    /// # Errors
    /// What Vulkan says; then what was to be sent still is.
    pub(crate) fn advance(&mut self, budget: u64) -> Result<Advanced, GpuError> {
        let mut advanced = Advanced::default();
        let slice = self.state.slice(budget);
        if !slice.is_empty() {
            while self.flying.len() >= FLYING {
                if let Some(oldest) = self.flying.pop_front() {
                    oldest.wait(self.device.hung_after())?;
                }
            }
            let (submission, bytes) = self.send(&slice)?;
            self.flying.push_back(submission);
            self.state.sent(&slice);
            advanced.bytes = bytes;
        } else if let Some(last) = self.flying.pop_back() {
            last.wait(self.device.hung_after())?;
            self.flying.clear();
        }
        advanced.moved = self.state.settle();
        Ok(advanced)
    }

    /// Records a slice and submits it.
    fn send(&self, slice: &[Piece]) -> Result<(Submission, u64), GpuError> {
        // What comes from the host goes through one staging buffer, which lives until the slice is done.
        let mut bytes = Vec::new();
        let mut copies: Vec<(Source, Arc<Buffer>, Vec<CopyRegion>)> = Vec::new();
        for piece in slice {
            let (held, column) = (&self.state.held[&piece.job.key], &COLUMNS[piece.job.space][piece.job.column]);
            let Some((source, to, mut region)) = self.state.region(piece, held) else { continue };
            if source == Source::Host {
                region.src_offset = bytes.len() as u64;
                held.block.pack(column, piece.job.done..piece.job.done + piece.elements, &mut bytes);
            }
            match copies.iter_mut().find(|(from, known, _)| *from == source && Arc::ptr_eq(known, to)) {
                Some((.., regions)) => regions.push(region),
                None => copies.push((source, to.clone(), vec![region])),
            }
        }
        let mut recorder = Recorder::for_uploads(&self.device, "upload slice")?;
        let staging = if bytes.is_empty() {
            None
        } else {
            let staging = Buffer::new(&self.device, "staging of a slice", BufferKind::Staging, bytes.len() as u64)?;
            staging.write(0, &bytes)?;
            Some(staging)
        };
        for (source, to, regions) in &copies {
            let from = match source {
                Source::Host => staging.as_ref(),
                Source::Old { space, column } => Some(&self.state.spaces[*space].buffers[*column]),
            };
            if let Some(from) = from {
                recorder.copy_regions(from, to, regions)?;
            }
        }
        let total = copies.iter().flat_map(|(.., regions)| regions).map(|region| region.bytes).sum();
        Ok((self.device.submit(recorder.finish()?, &[])?, total))
    }
}

/// Part of a job.
struct Piece {
    job: Job,
    elements: u64,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Source {
    Host,
    Old { space: usize, column: usize },
}

impl State {
    fn drop_all_but(&mut self, wanted: &HashSet<Key>) {
        let gone: Vec<Key> = self.held.keys().filter(|key| !wanted.contains(key)).copied().collect();
        for key in gone {
            let Some(held) = self.held.remove(&key) else { continue };
            for space in 0..SPACES {
                let (count, share) = (held.block.elements(space), held.shares[space]);
                if let Some(first) = share.first {
                    self.spaces[space].arena.release(first, count);
                }
                if let (Some(first), Some(next)) = (share.next, &mut self.next[space]) {
                    next.arena.release(first, count);
                }
            }
        }
        self.jobs.retain(|job| wanted.contains(&job.key));
    }

    /// Finds places in a space for all of `wanted`, all of which are held.
    fn fit(&mut self, device: &Arc<Device>, ways: &Ways, space: usize, wanted: &[Block]) -> Result<(), GpuError> {
        let columns = COLUMNS[space];
        let needed: u64 = wanted.iter().map(|block| block.elements(space)).sum();
        let enough = roomy(device, ways, columns, needed);

        // A move that has begun goes on where what is new fits in as well.
        if let Some(next) = &mut self.next[space] {
            let mut arena = next.arena.clone();
            let mut places = Vec::new();
            let unplaced = wanted.iter().filter(|b| self.held[&b.key()].shares[space].next.is_none());
            for block in unplaced {
                places.push((block.key(), arena.place(block.elements(space))));
            }
            if arena.capacity() <= 2 * enough && places.iter().all(|(_, place)| place.is_some()) {
                next.arena = arena;
                for (key, place) in places {
                    self.share(key, space, |share| share.next = place);
                    self.queue(key, space, false);
                }
                return Ok(());
            }
            self.next[space] = None;
            self.jobs.retain(|job| job.space != space);
            for block in wanted {
                self.share(block.key(), space, |share| share.next = None);
            }
        }

        // Free ranges, unless the buffers are far larger than they need be.
        let mut arena = self.spaces[space].arena.clone();
        let mut places = Vec::new();
        for block in wanted.iter().filter(|b| self.held[&b.key()].shares[space].first.is_none()) {
            places.push((block.key(), arena.place(block.elements(space))));
        }
        if arena.capacity() <= 2 * enough && places.iter().all(|(_, place)| place.is_some()) {
            self.spaces[space].arena = arena;
            for (key, place) in places {
                self.share(key, space, |share| share.first = place);
            }
            // Those whose move was given up go on where they were.
            let queued: HashSet<Key> = self.jobs.iter().filter(|job| job.space == space).map(|job| job.key).collect();
            let whole = |key: &Key| self.held[key].shares[space].whole || queued.contains(key);
            let unfinished: Vec<Key> = wanted.iter().map(Block::key).filter(|key| !whole(key)).collect();
            for key in unfinished {
                self.queue(key, space, false);
            }
            return Ok(());
        }

        // Other buffers: what is there moves on the device, the rest comes from the host.
        let mut next = Space::new(device, columns, enough)?;
        self.jobs.retain(|job| job.space != space);
        for block in wanted {
            let place = next.arena.place(block.elements(space));
            self.share(block.key(), space, |share| share.next = place);
            let moves = self.held[&block.key()].shares[space].whole;
            self.queue(block.key(), space, moves);
        }
        self.next[space] = Some(next);
        Ok(())
    }

    fn share(&mut self, key: Key, space: usize, change: impl FnOnce(&mut Share)) {
        if let Some(held) = self.held.get_mut(&key) {
            change(&mut held.shares[space]);
        }
    }

    /// Queues all of a block's share of a space. One without elements has nothing to wait for.
    fn queue(&mut self, key: Key, space: usize, moves: bool) {
        if self.held.get(&key).is_some_and(|held| held.block.elements(space) > 0) {
            let jobs = (0..COLUMNS[space].len()).map(|column| Job { key, space, column, done: 0, moves });
            self.jobs.extend(jobs);
        } else if self.next[space].is_none() {
            self.share(key, space, |share| share.whole = true);
        }
    }

    /// The next pieces, of about `budget` bytes together, at least one element.
    fn slice(&self, budget: u64) -> Vec<Piece> {
        let (mut left, mut pieces) = (budget.max(1), Vec::new());
        for job in &self.jobs {
            let Some(held) = self.held.get(&job.key) else { continue };
            let each = COLUMNS[job.space][job.column].element_bytes;
            let remaining = held.block.elements(job.space) - job.done;
            let elements = remaining.min((left / each).max(u64::from(pieces.is_empty())));
            if elements > 0 {
                pieces.push(Piece { job: *job, elements });
            }
            // Only the last job of a slice is left unfinished by it.
            if elements < remaining {
                break;
            }
            left = left.saturating_sub(elements * each);
        }
        pieces
    }

    /// From where to where a piece goes.
    fn region(&self, piece: &Piece, held: &Held) -> Option<(Source, &Arc<Buffer>, CopyRegion)> {
        let Job { space, column, done, moves, .. } = piece.job;
        let (each, share) = (COLUMNS[space][column].element_bytes, held.shares[space]);
        let (to, first) = match &self.next[space] {
            Some(next) => (&next.buffers[column], share.next?),
            None => (&self.spaces[space].buffers[column], share.first?),
        };
        let (source, src_offset) =
            if moves { (Source::Old { space, column }, (share.first? + done) * each) } else { (Source::Host, 0) };
        let region = CopyRegion { src_offset, dst_offset: (first + done) * each, bytes: piece.elements * each };
        Some((source, to, region))
    }

    /// Takes note that a slice is on its way; its pieces are those of the first jobs, in their order.
    fn sent(&mut self, slice: &[Piece]) {
        for piece in slice {
            let Some(job) = self.jobs.front_mut() else { return };
            job.done += piece.elements;
            let job = *job;
            if self.held.get(&job.key).is_none_or(|held| job.done >= held.block.elements(job.space)) {
                self.jobs.pop_front();
                // The jobs of a share stand next to each other.
                let last = self.jobs.front().is_none_or(|next| (next.key, next.space) != (job.key, job.space));
                if last && self.next[job.space].is_none() {
                    self.share(job.key, job.space, |share| share.whole = true);
                }
            }
        }
    }

    /// Takes over the spaces whose move is complete; true where there is one.
    fn settle(&mut self) -> bool {
        let mut moved = false;
        for space in 0..SPACES {
            if self.next[space].is_none() || self.jobs.iter().any(|job| job.space == space) {
                continue;
            }
            if let Some(next) = self.next[space].take() {
                self.spaces[space] = next;
                for held in self.held.values_mut() {
                    held.shares[space] = Share { first: held.shares[space].next, whole: true, next: None };
                }
                moved = true;
            }
        }
        moved
    }
}
