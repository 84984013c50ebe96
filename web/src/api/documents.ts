// The JSON documents of the server (schema/openapi.yaml), as far as the viewer reads them.

/** [x, y, z, qx, qy, qz, qw] */
export type PoseArray = [number, number, number, number, number, number, number];
type Vector3 = [number, number, number];

export interface MapSummary {
  name: string;
  lattice: { kind: "fibonacci" | "fibonacci-bands"; size: number };
  revision: number;
  created: string;
  cells: number;
  planes: number;
  constraints: number;
  encoded_bytes: number;
  stored_bytes: number;
  scans: number;
  raw_bytes: number;
  voxel_bytes: number;
  bounds: { min: Vector3; max: Vector3 } | null;
  sessions: string[];
}

export interface CellSummary {
  id: number;
  hash: string;
  pose: PoseArray;
  session: string;
  sequence: number;
  planes: number;
  bytes: number;
}

export interface Session {
  name: string;
  robot: string;
  sensor: string;
  started: string | null;
  cells: number;
  planes: number;
  encoded_bytes: number;
  aligned: boolean;
}

export interface Scores {
  points: number;
  hits: number;
  inlier_ratio_all: number;
  inlier_ratio_hit: number;
  share_in_front: number;
  share_beyond: number;
  median_residual_m: number;
}

export interface LoopExplanation {
  id: number;
  from: number;
  to: number;
  origin: "mapper" | "detection" | "user";
  scores: Scores;
  weight: number;
  pinned: boolean;
  verdict: "trusted" | "pinned" | "accepted" | "weakened" | "rejected";
  gap_m: number;
  gap_deg: number;
  chi2: number;
  revision: number;
}

export interface Place {
  cell: { id: number; hash: string };
  T_map_scan: PoseArray;
  scores: Scores;
  confidence: number;
  similarity: number;
  surroundings: { cells: number; parts: number; agreement: number; free_ratio: number };
  accepted?: boolean;
}

export interface Relocalisation extends Partial<Place> {
  found: boolean;
  degenerate?: boolean;
  alternatives: Place[];
  cells_considered: number;
  time_ms: number;
}

export interface Job {
  id: number;
  map: string;
  kind: "ingest" | "merge" | "convert";
  state: "queued" | "running" | "succeeded" | "failed" | "cancelled";
  session: string | null;
  scans_done: number;
  scans_total: number;
  cells_done: number;
  progress: number | null;
  scans_per_second: number;
  eta_s: number | null;
  worker: string | null;
  error: { code: string; message: string } | null;
}

type Figure = number | null;

export interface ComparisonRow {
  name: string;
  measured: boolean;
  note?: string;
  f_score: Record<"0.05" | "0.1" | "0.2", Figure>;
  bytes: Figure;
  bytes_per_m: Figure;
  accuracy_m: Figure;
  completeness_m: Figure;
  registration_error_m: Figure;
  registration_turn_deg: Figure;
}

export interface Comparison {
  dataset: string;
  scans: number;
  held_back: number;
  length_m: number;
  rows: ComparisonRow[];
}

export interface ChangeRegion {
  change: "vanished" | "appeared";
  centroid: Vector3;
  patches: number;
  area_m2: number;
}

export interface SessionDiff {
  revision: number;
  sessions: [string, string];
  pairs: number;
  regions: ChangeRegion[];
  cells: { id: number; session: string; vanished: number; appeared: number; changed: number[] }[];
}
