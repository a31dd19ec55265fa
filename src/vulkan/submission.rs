//! Submitted commands.

use std::{sync::Arc, time::Duration};

use ash::vk;

use super::{Buffer, Device, VulkanError, commands::CommandSlot, lock};

/// A borrowed command slot. It returns to the device on drop, which is not before the device has finished with it.
#[derive(Debug)]
pub(super) struct Lease {
    pub(super) slot: Arc<CommandSlot>,
    pub(super) device: Device,
}

impl Lease {
    pub(super) fn take(device: &Device, name: &str) -> Result<Self, VulkanError> {
        let idle = lock(device.idle()).pop();
        let slot = match idle {
            Some(slot) => slot,
            None => Arc::new(CommandSlot::new(device.raw(), device.queue_family())?),
        };
        let lease = Self { slot, device: device.clone() };
        let functions = &device.raw().functions;
        // SAFETY: no submission uses an idle slot, and only this lease has it now.
        let reset = unsafe { functions.reset_command_pool(lease.slot.pool.raw(), vk::CommandPoolResetFlags::empty()) };
        reset.map_err(VulkanError::call("vkResetCommandPool", name))?;
        // SAFETY: as above.
        let reset = unsafe { functions.reset_fences(&[lease.slot.fence.raw()]) };
        reset.map_err(VulkanError::call("vkResetFences", name))?;
        Ok(lease)
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        lock(self.device.idle()).push(Arc::clone(&self.slot));
    }
}

/// Objects of a submission, kept alive until it has finished.
#[derive(Default)]
pub(super) struct Used {
    pub(super) buffers: Vec<Buffer>,
    pub(super) others: Vec<Arc<dyn Send + Sync>>,
}

impl std::fmt::Debug for Used {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Used").field("buffers", &self.buffers).finish_non_exhaustive()
    }
}

/// Submitted commands, running or finished. Dropping it waits for them.
#[derive(Debug)]
pub struct Submission {
    name: String,
    used: Used,
    timestamps: u32,
    ended: bool,
    lease: Lease,
}

impl Submission {
    /// Submits the commands of `lease`, which use `used`.
    pub(super) fn start(name: String, used: Used, timestamps: u32, lease: Lease) -> Result<Self, VulkanError> {
        for buffer in &used.buffers {
            buffer.begin_use();
        }
        // From here on, dropping `submission` waits for the commands.
        let mut submission = Self { name, used, timestamps, ended: false, lease };
        let Lease { slot, device } = &submission.lease;
        let commands = [slot.commands];
        let info = [vk::SubmitInfo::default().command_buffers(&commands)];
        let queue = lock(device.queue());
        let submitted = if device.simulated().loses_device() {
            Err(vk::Result::ERROR_DEVICE_LOST)
        } else {
            // SAFETY: the lock keeps other threads off the queue. The fence was reset with the lease. The submission
            // keeps all objects of the commands until the fence has signalled.
            unsafe { device.raw().functions.queue_submit(*queue, &info, slot.fence.raw()) }
        };
        drop(queue);
        if let Err(source) = submitted {
            // Nothing was submitted, so there is nothing to wait for.
            submission.end();
            return Err(VulkanError::call("vkQueueSubmit", &submission.name)(source));
        }
        Ok(submission)
    }

    /// Waits until the commands have finished, for at most `timeout`. Returns whether they have finished.
    ///
    /// # Errors
    ///
    /// [`VulkanError::DeviceLost`].
    pub fn wait(&mut self, timeout: Duration) -> Result<bool, VulkanError> {
        if self.ended {
            return Ok(true);
        }
        let nanoseconds = u64::try_from(timeout.as_nanos()).unwrap_or(u64::MAX);
        let fence = [self.lease.slot.fence.raw()];
        // SAFETY: the fence was given to the submission, and only this lease resets it.
        let waited = unsafe { self.lease.device.raw().functions.wait_for_fences(&fence, true, nanoseconds) };
        match waited {
            Ok(()) => {
                self.end();
                Ok(true)
            }
            Err(vk::Result::TIMEOUT) => Ok(false),
            Err(source) => Err(VulkanError::call("vkWaitForFences", &self.name)(source)),
        }
    }

    /// Waits until the commands have finished, without a time limit.
    ///
    /// # Errors
    ///
    /// [`VulkanError::DeviceLost`].
    pub fn finish(mut self) -> Result<(), VulkanError> {
        while !self.wait(Duration::MAX)? {}
        Ok(())
    }

    /// Returns the times of [`super::Recorder::timestamp`] relative to the first; empty if the device has no clock.
    ///
    /// On a software device these are wall times.
    ///
    /// # Errors
    ///
    /// [`VulkanError::Misuse`] before the commands have finished.
    pub fn timestamps(&self) -> Result<Vec<Duration>, VulkanError> {
        if !self.ended {
            return Err(VulkanError::misuse(&self.name, "it is unfinished, so its timestamps are unknown"));
        }
        if self.timestamps == 0 {
            return Ok(Vec::new());
        }
        let mut ticks = vec![0_u64; self.timestamps as usize];
        let pool = self.lease.slot.timestamps.raw();
        let functions = &self.lease.device.raw().functions;
        // SAFETY: the pool has at least this number of queries, all written by commands that have finished.
        let read = unsafe { functions.get_query_pool_results(pool, 0, &mut ticks, vk::QueryResultFlags::TYPE_64) };
        read.map_err(VulkanError::call("vkGetQueryPoolResults", &self.name))?;
        let limits = self.lease.device.limits();
        let mask = u64::MAX >> (u64::BITS - limits.timestamp_valid_bits.min(u64::BITS));
        let since_first = |tick: &u64| duration(tick.wrapping_sub(ticks[0]) & mask, limits.timestamp_period_ns);
        Ok(ticks.iter().map(since_first).collect())
    }

    /// Releases the objects of the commands.
    fn end(&mut self) {
        self.ended = true;
        let used = std::mem::take(&mut self.used);
        for buffer in &used.buffers {
            buffer.end_use();
        }
    }
}

impl Drop for Submission {
    fn drop(&mut self) {
        while !self.ended {
            if self.wait(Duration::MAX).is_err() {
                self.lease.device.wait_idle();
                self.end();
            }
        }
    }
}

#[expect(clippy::cast_precision_loss, reason = "2^53 ticks are hours; a day's submission may be off by a tick")]
fn duration(ticks: u64, period_ns: f32) -> Duration {
    Duration::try_from_secs_f64(ticks as f64 * f64::from(period_ns) * 1e-9).unwrap_or(Duration::MAX)
}
