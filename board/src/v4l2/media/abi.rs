//! The kernel's structures of media devices, from `linux/media.h`.

plain! {
    /// `struct media_v2_entity`.
    Entity(96, 96) {
        /// Number of the entity.
        id: u32,
        /// Name of the entity, terminated by NUL.
        name: [u8; 64],
        /// [`SENSOR`], [`VIDEO`] or another function.
        function: u32,
        /// Flags of the entity.
        flags: u32,
        /// Reserved by the kernel; always 0.
        reserved: [u32; 5],
    }
}

plain! {
    /// `struct media_v2_interface` of a device node.
    Interface(112, 112) {
        /// Number of the interface.
        id: u32,
        /// Type of the device node.
        kind: u32,
        /// Flags of the interface.
        flags: u32,
        /// Reserved by the kernel; always 0.
        reserved: [u32; 9],
        /// Device number of the node, major and minor.
        device: [u32; 2],
        /// Bytes of the kernel's union that this program does not use.
        rest: [u32; 14],
    }
}

plain! {
    /// `struct media_v2_pad`.
    Pad(32, 32) {
        /// Number of the pad in the device.
        id: u32,
        /// Number of the entity that has the pad.
        entity: u32,
        /// [`PAD_SINK`] or [`PAD_SOURCE`].
        flags: u32,
        /// Number of the pad in its entity.
        index: u32,
        /// Reserved by the kernel; always 0.
        reserved: [u32; 4],
    }
}

plain! {
    /// `struct media_v2_link`.
    Link(40, 40) {
        /// Number of the link.
        id: u32,
        /// Number of the pad or interface where the link starts.
        source: u32,
        /// Number of the pad or entity where the link ends.
        sink: u32,
        /// [`LINK_ENABLED`] and other flags of the link.
        flags: u32,
        /// Reserved by the kernel; always 0.
        reserved: [u32; 6],
    }
}

plain! {
    /// `struct media_v2_topology`.
    Counts(72, 72) {
        /// Version of the topology, which changes with the graph.
        version: u64,
        /// Number of entities; the second word is 0.
        entities: [u32; 2],
        /// Address of the array of entities, or 0 to request the number alone.
        entities_at: u64,
        /// Number of interfaces; the second word is 0.
        interfaces: [u32; 2],
        /// Address of the array of interfaces, or 0 to request the number alone.
        interfaces_at: u64,
        /// Number of pads; the second word is 0.
        pads: [u32; 2],
        /// Address of the array of pads, or 0 to request the number alone.
        pads_at: u64,
        /// Number of links; the second word is 0.
        links: [u32; 2],
        /// Address of the array of links, or 0 to request the number alone.
        links_at: u64,
    }
}

plain! {
    /// `struct media_pad_desc`.
    LinkEnd(20, 20) {
        /// Number of the entity.
        entity: u32,
        /// Number of the pad in its entity.
        index: u16,
        /// Reserved by the kernel; always 0.
        gap: u16,
        /// Flags of the pad.
        flags: u32,
        /// Reserved by the kernel; always 0.
        reserved: [u32; 2],
    }
}

plain! {
    /// `struct media_link_desc`.
    LinkSetup(52, 52) {
        /// Source pad of the link.
        source: LinkEnd = LinkEnd::default(),
        /// Sink pad of the link.
        sink: LinkEnd = LinkEnd::default(),
        /// [`LINK_ENABLED`], or 0 to disable the link.
        flags: u32,
        /// Reserved by the kernel; always 0.
        reserved: [u32; 2],
    }
}

/// `MEDIA_ENT_F_CAM_SENSOR`.
pub const SENSOR: u32 = 0x0002_0001;
/// `MEDIA_ENT_F_IO_V4L`: a node that captures or outputs video.
pub const VIDEO: u32 = 0x0001_0001;
/// `MEDIA_PAD_FL_SINK`.
pub const PAD_SINK: u32 = 1;
/// `MEDIA_PAD_FL_SOURCE`.
pub const PAD_SOURCE: u32 = 2;
/// `MEDIA_LNK_FL_ENABLED`.
pub const LINK_ENABLED: u32 = 1;
/// `MEDIA_LNK_FL_IMMUTABLE`.
pub const LINK_IMMUTABLE: u32 = 2;
/// `MEDIA_LNK_FL_LINK_TYPE`: the bits that hold a link's type.
pub const LINK_TYPE: u32 = 0xf000_0000;
/// `MEDIA_LNK_FL_DATA_LINK`: a link between two pads.
pub const LINK_DATA: u32 = 0;
/// `MEDIA_LNK_FL_INTERFACE_LINK`: a link between a device node and its entity.
pub const LINK_INTERFACE: u32 = 0x1000_0000;
