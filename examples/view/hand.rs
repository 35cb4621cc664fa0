//! Keys and mouse.

use crate::rig::Rig;
use glam::{DVec2, DVec3};
use std::collections::HashSet;
use std::time::{Duration, Instant};
use winit::event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent};
use winit::keyboard::{KeyCode, PhysicalKey};

/// Angle of a key's orbit.
const STEP: f64 = std::f64::consts::PI / 36.0;

/// Longest time between the presses of a double click, and the way of the cursor in pixels.
const DOUBLE: (Duration, f64) = (Duration::from_millis(400), 4.0);

/// Keys that fly while they are held, by camera axes: right, down, ahead.
const FLIGHT: [(KeyCode, DVec3); 6] = [
    (KeyCode::KeyA, DVec3::NEG_X),
    (KeyCode::KeyD, DVec3::X),
    (KeyCode::KeyE, DVec3::NEG_Y),
    (KeyCode::KeyQ, DVec3::Y),
    (KeyCode::KeyS, DVec3::NEG_Z),
    (KeyCode::KeyW, DVec3::Z),
];

/// What is held.
#[derive(Default)]
pub(crate) struct Hand {
    held: HashSet<KeyCode>,
    buttons: HashSet<MouseButton>,
    cursor: DVec2,
    /// Time and place of the left button's last press, unless it ended a double click.
    pressed: Option<(Instant, DVec2)>,
    double_click: Option<DVec2>,
}

impl Hand {
    /// Moves the camera by an event; true if it has moved.
    pub(crate) fn moves(&mut self, event: &WindowEvent, rig: &mut Rig, height: u32) -> bool {
        match event {
            WindowEvent::CursorMoved { position, .. } => {
                let cursor = DVec2::new(position.x, position.y);
                let by = (cursor - self.cursor) / f64::from(height.max(1));
                self.cursor = cursor;
                self.drag(by, rig)
            }
            WindowEvent::MouseInput { state, button, .. } => {
                match state {
                    ElementState::Pressed => self.click(*button),
                    ElementState::Released => {
                        self.buttons.remove(button);
                    }
                }
                false
            }
            WindowEvent::MouseWheel { delta, .. } => {
                let lines = match delta {
                    MouseScrollDelta::LineDelta(_, lines) => f64::from(*lines),
                    MouseScrollDelta::PixelDelta(pixels) => pixels.y / 40.0,
                };
                rig.dolly(0.9_f64.powf(lines));
                true
            }
            _ => false,
        }
    }

    fn click(&mut self, button: MouseButton) {
        self.buttons.insert(button);
        let (now, last) = (Instant::now(), self.pressed.take());
        if button != MouseButton::Left {
            return;
        }
        let is_second = |(time, place): (Instant, DVec2)| {
            now.duration_since(time) < DOUBLE.0 && place.distance(self.cursor) < DOUBLE.1
        };
        match last.is_some_and(is_second) {
            true => self.double_click = Some(self.cursor),
            false => self.pressed = Some((now, self.cursor)),
        }
    }

    /// Place of a double click since the last call, in pixels of the window.
    pub(crate) fn double_click(&mut self) -> Option<DVec2> {
        self.double_click.take()
    }

    /// Moves by a way of the cursor, in heights of the window.
    fn drag(&self, by: DVec2, rig: &mut Rig) -> bool {
        let pans = self.buttons.contains(&MouseButton::Right);
        if pans {
            let height = rig.distance() * f64::from(rig.camera.height) / rig.camera.focal.y;
            rig.fly((-by * height).extend(0.0));
        } else if self.buttons.contains(&MouseButton::Left) {
            rig.orbit(4.0 * by.x, -4.0 * by.y);
        }
        pans || self.buttons.contains(&MouseButton::Left)
    }

    /// Keeps a key, and moves the camera by a step if it is one of those; returns a pressed key.
    pub(crate) fn press(&mut self, key: PhysicalKey, state: ElementState, rig: &mut Rig) -> Option<KeyCode> {
        let PhysicalKey::Code(key) = key else { return None };
        if state == ElementState::Released {
            self.held.remove(&key);
            return None;
        }
        self.held.insert(key);
        match key {
            KeyCode::ArrowLeft => rig.orbit(-STEP, 0.0),
            KeyCode::ArrowRight => rig.orbit(STEP, 0.0),
            KeyCode::ArrowUp => rig.orbit(0.0, STEP),
            KeyCode::ArrowDown => rig.orbit(0.0, -STEP),
            KeyCode::Comma => rig.roll(-STEP),
            KeyCode::Period => rig.roll(STEP),
            KeyCode::BracketLeft => rig.zoom(1.0 / 1.1),
            KeyCode::BracketRight => rig.zoom(1.1),
            _ => {}
        }
        Some(key)
    }

    /// True if a key is held that flies.
    pub(crate) fn flies(&self) -> bool {
        FLIGHT.iter().any(|(key, _)| self.held.contains(key))
    }

    /// Flies for some seconds; a second covers the distance to the target.
    pub(crate) fn fly(&self, seconds: f64, rig: &mut Rig) {
        let held = FLIGHT.iter().filter(|(key, _)| self.held.contains(key));
        let way: DVec3 = held.map(|(_, way)| *way).sum();
        rig.fly(way * seconds * rig.distance());
    }

    /// Lets go of everything, as when the window loses the focus.
    pub(crate) fn release(&mut self) {
        self.held.clear();
        self.buttons.clear();
    }
}
