//! A renderer of C with the frame that it records.

use super::failure::{ASHFALL_ERROR_INTERNAL, Failure};
use crate::gpu::HostCommands;
use crate::gpu::ash::vk::CommandBuffer as VkCommandBuffer;
use crate::render::{PickReport, Renderer};
use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard};

/// A renderer, and the frame that it records.
#[derive(Debug)]
pub(super) struct RendererSession {
    renderer: Renderer,
    /// The host's number of the frame, and its commands.
    frame: Option<(u64, HostCommands)>,
    /// Reports that the host has not taken, oldest first.
    reports: VecDeque<PickReport>,
}

impl RendererSession {
    pub(super) fn new(renderer: Renderer) -> RendererSession {
        RendererSession {
            renderer,
            frame: None,
            reports: VecDeque::new(),
        }
    }

    pub(super) fn renderer(&mut self) -> &mut Renderer {
        &mut self.renderer
    }

    /// Reports of finished pictures that the host has not taken, oldest first.
    pub(super) fn reports(&mut self) -> &mut VecDeque<PickReport> {
        self.reports.extend(self.renderer.picks());
        &mut self.reports
    }

    /// Renderer, and commands of the frame.
    pub(super) fn parts(&mut self) -> Result<(&mut Renderer, &mut HostCommands), Failure> {
        match &mut self.frame {
            Some((_, commands)) => Ok((&mut self.renderer, commands)),
            None => Err(Failure::argument("commands: none")),
        }
    }

    /// Commands of the host's frame: pictures of one frame share its resources.
    ///
    /// # Safety
    /// As [`HostCommands::wrap`].
    pub(super) unsafe fn begin(&mut self, commands: VkCommandBuffer, frame: u64) -> Result<(), Failure> {
        if commands == VkCommandBuffer::null() {
            return Err(Failure::argument("commands: a null handle"));
        }
        match &self.frame {
            Some((last, known)) if *last == frame && known.is_of(commands) => {}
            // SAFETY: as the caller says.
            _ => self.frame = Some((frame, unsafe { HostCommands::wrap(commands) })),
        }
        Ok(())
    }
}

/// Exclusive access to a renderer; refused after a panic.
pub(super) fn lock(session: &Mutex<RendererSession>) -> Result<MutexGuard<'_, RendererSession>, Failure> {
    session.lock().map_err(|_| Failure {
        code: ASHFALL_ERROR_INTERNAL,
        message: "renderer: a fault of the library stopped an earlier call".into(),
    })
}
