"""What to do beyond the sentence: a line for each error and remark that an artist may meet.

`troubleshooting.py` makes the manual's page of it. The sentences are those of the code; a test
finds one that is not there any more, and one of a section's files that has no line here.
"""

from __future__ import annotations

from typing import NamedTuple


class Advice(NamedTuple):
    """A sentence, by its template, and what to do, in each language."""

    template: str
    en: str
    ja: str


class Section(NamedTuple):
    """A heading in each language, the files whose errors are all here, and the advice."""

    en: str
    ja: str
    files: tuple[str, ...]
    advice: tuple[Advice, ...]


RIG = Section(
    "The rig",
    "リグ",
    (
        "core/blender/new_rig.py",
        "core/blender/parts.py",
        "core/blender/scene.py",
        "core/blender/viewer.py",
        "core/light/checks.py",
    ),
    (
        Advice(
            "The rig has no {noun}: {remedy}.",
            "Press Add Rig, or give an object the role in the panel Object.",
            "「リグを追加」を押すか、「オブジェクト」パネルでオブジェクトに役割を設定します。",
        ),
        Advice(
            "The rig has {n} {field} ({names}): keep one and set the others to None.",
            "The list in the panel Rig selects each of them.",
            "「リグ」パネルの一覧で、それぞれを選択できます。",
        ),
        Advice(
            "'{name}' cannot be glass, for {why}: select your glass, or nothing for a ball.",
            "Cameras, lights and empties have no faces. Select a mesh.",
            "カメラ、ライト、エンプティには面がありません。メッシュを選択します。",
        ),
        Advice(
            "'{name}' is hidden{by} and cannot be glass: show it, or deselect it.",
            "Press Alt H in the viewport, and look at the eyes in the outliner.",
            "ビューポートで Alt H を押し、アウトライナーの目のアイコンも確かめます。",
        ),
        Advice(
            "'{name}' has no faces and cannot be glass: give it some, or deselect it.",
            "A curve gets faces by Bevel or Screw, a cloud of points by none.",
            "カーブはベベルやスクリューで面になります。点群は面になりません。",
        ),
        Advice(
            "{name} is no closed body, but flat: give it a thickness, as by a Solidify modifier, or"
            " deselect it.",
            "Thicken, in the first panel, adds the modifier.",
            "最初のパネルのボタンで、ソリッド化モディファイアーを追加できます。",
        ),
        Advice(
            "'{name}' has the role {role}, but {why}: set its role to None.",
            "The role is in the panel Object. Only things with a surface are parts.",
            "役割は「オブジェクト」パネルにあります。面を持つものだけが部品になります。",
        ),
        Advice(
            "The viewer '{viewer}' is disabled or left out of the view layer, so that its place is"
            " unknown: enable it, or make it the scene's camera.",
            "Look for the checkbox of its collection in the outliner.",
            "アウトライナーで、コレクションのチェックボックスを確かめます。",
        ),
        Advice(
            "The viewer '{name}' is sheared or has no size: undo the uneven scale of it or of its"
            " parents.",
            "Select the camera and press Alt S; do the same with its parent.",
            "カメラを選択して Alt S を押します。親にも同じことをします。",
        ),
        Advice(
            "The viewer '{viewer}' is no camera: choose one.",
            "Choose it in the panel Rig, under Viewer.",
            "「リグ」パネルの「視点」で選びます。",
        ),
        Advice(
            "The viewer '{viewer}' is a panoramic or custom camera, whose image is no flat window:"
            " make it perspective or orthographic.",
            "The type is in the camera's properties, under Lens.",
            "カメラのプロパティの「レンズ」でタイプを変えます。",
        ),
        Advice(
            "The glass '{glass}' cuts the plane of the orthographic viewer '{viewer}': move it"
            " out.",
            "Move the camera back: its distance changes nothing in the image.",
            "カメラを後ろへ下げます。距離を変えても像は変わりません。",
        ),
        Advice(
            "The viewer '{viewer}' is inside the glass '{glass}': move it out.",
            "An eye is in air. Glass around it has to be hollow.",
            "目は空気の中にあります。まわりのガラスは中空でなければなりません。",
        ),
    ),
)

GLASS = Section(
    "Glass",
    "ガラス",
    ("core/light/media.py",),
    (
        Advice(
            "{owner} has no faces with an area: give it some, or set its role to None.",
            "In Edit Mode, Mesh > Clean Up > Degenerate Dissolve shows what is left.",
            "編集モードの メッシュ > クリーンアップ > 大きさ 0 を融解 で確かめます。",
        ),
        Advice(
            "{owner} is no closed body, but flat: give it a thickness, as by a Solidify modifier,"
            " or set its role to None.",
            "Light has to come in and go out again: glass needs two sides.",
            "光は入って出ていきます。ガラスには両側の面が必要です。",
        ),
        Advice(
            "{n} glass solids around '{name}' overlap or nest: join them or keep at most {most}.",
            "A Boolean modifier makes one body of many.",
            "ブーリアンモディファイアーで一つにまとめます。",
        ),
        Advice(
            "The glass '{name}' is in {n} pieces that overlap or nest: merge its vertices by"
            " distance, or keep at most {most} pieces.",
            "In Edit Mode press M, and choose By Distance.",
            "編集モードで M を押し、「距離で」を選びます。",
        ),
    ),
)

PICTURE = Section(
    "The picture",
    "絵",
    (
        "core/blender/elements.py",
        "core/blender/picture.py",
        "core/image/flat_picture.py",
        "core/solve/picture_coverage.py",
        "operators/choose_picture.py",
    ),
    (
        Advice(
            "The picture '{name}' shows no image: give its material an image texture, or choose an"
            " image in its Kiriko settings.",
            "Open Picture, beside the picture in the panel Rig, does both.",
            "「リグ」パネルの絵の横にある「絵を開く」で、両方を行えます。",
        ),
        Advice(
            "'{image}' cannot be {owner}, for it is in the Image Editor only: save it there (Image"
            " > Save As), and choose that file.",
            "A render result has no pixels of its own until it is saved.",
            "レンダー結果は、保存するまでピクセルを持ちません。",
        ),
        Advice(
            "The image '{image}' of {owner} is {kind}, and moving pictures are not read yet: choose"
            " one frame's file, with Source: Single Image.",
            "Render > Render Image of the sequence gives such a file.",
            "1 フレームをレンダリングすれば、そのファイルが得られます。",
        ),
        Advice(
            "The image '{image}' of {owner} cannot be read from {place}: the file is missing or"
            " broken; choose another or find it again.",
            "File > External Data > Find Missing Files looks for it.",
            "ファイル > 外部データ > 欠けているファイルを探す で見つけます。",
        ),
        Advice(
            "The image '{image}' of {owner} is in the colour space {space}, which Kiriko does not"
            " know for 8-bit images: set it to sRGB, Linear Rec.709 or Non-Color.",
            "The colour space is in the image's own settings, in the Image Editor.",
            "色空間は、画像エディターの画像の設定にあります。",
        ),
        Advice(
            "The image '{image}' of {owner} has pixels that are not finite numbers: repair it.",
            "They come from a render that divided by nothing. Save it anew as PNG.",
            "計算に失敗したレンダーに含まれることがあります。PNG で保存し直します。",
        ),
        Advice(
            "The picture '{picture}' is no flat rectangle: choose a flat plane for it.",
            "Add > Mesh > Plane is one. Scale it, but do not move its corners.",
            "追加 > メッシュ > 平面 を使います。拡大縮小はできますが、角は動かしません。",
        ),
        Advice(
            "The picture '{picture}' is seen edge-on: turn it to the viewer.",
            "Look through the viewer while you turn it.",
            "「視点から見る」で見ながら回します。",
        ),
        Advice(
            "The viewer '{viewer}' does not see the picture '{picture}', {why}.",
            "Turn the camera to the glass, or move the picture into its view.",
            "カメラをガラスに向けるか、絵を視野の中に動かします。",
        ),
        Advice(
            "No file is chosen: choose an image.",
            "Click a file in the list before you press the button.",
            "ボタンを押す前に、一覧でファイルをクリックします。",
        ),
        Advice(
            "There is no file {path}: choose an image.",
            "It was moved or renamed since the list was read.",
            "一覧を読み込んだ後で、移動または名前が変更されました。",
        ),
        Advice(
            "The file has no image '{image}': open it from its own file.",
            "It was removed from this .blend meanwhile.",
            "その間に、この .blend から削除されました。",
        ),
    ),
)

RESULT = Section(
    "The result",
    "結果",
    ("core/solve/remarks.py", "core/solve/light_remarks.py", "core/solve/dark.py"),
    (
        Advice(
            "The display stays dark: {remedy}.",
            "Look at the red lines over the viewport: they end where the light is lost.",
            "ビューポートの赤い線を見ます。線の終わりが、光の失われる場所です。",
        ),
        Advice(
            "The display stays dark: {share} of the picture's light goes through gaps in the glass"
            " '{glass}': close them.",
            "Select Faults, in the first panel, selects the open edges. F fills them.",
            "最初のパネルのボタンで、開いた辺を選択できます。F を押すと面が張られます。",
        ),
        Advice(
            "{share} of the picture's light goes through gaps in the glass '{glass}' ({n} open"
            " edges): close them.",
            "Select Faults, in the first panel, selects them. F fills them.",
            "最初のパネルのボタンで選択できます。F を押すと面が張られます。",
        ),
        Advice(
            "{share} of the picture's light is caught in the glass, however high Max Events is:"
            " look for faces that lie in one another, or for a hollow that touches the outside.",
            "Move walls that share a place apart by a tenth of a millimetre.",
            "同じ場所にある壁を、0.1 mm ほど離します。",
        ),
        Advice(
            "{share} of the picture's light meets more than {most} surfaces and is cut off: raise"
            " Max Events.",
            "Max Events is under Solve > Settings. It costs time only where light needs it.",
            "「計算 > 設定」にあります。必要な光にだけ時間がかかります。",
        ),
        Advice(
            "{share} of the view is off by more than the tolerance, or lost, where it changes"
            " within a viewer pixel: {remedy}.",
            "This is the light of cut edges. A larger tolerance hides the remark, not the light.",
            "カットの稜線の光です。許容誤差を上げても、表示が消えるだけで光は変わりません。",
        ),
        Advice(
            "{share} of the light meets gaps or overlaps of glass that are thinner than the mesh's"
            " own error, and may go another way: use the same mesh for faces that touch, or move"
            " them apart.",
            "A liquid in a glass is best made of the glass's own inner faces.",
            "グラスの中の液体は、グラスの内側の面をそのまま使って作ります。",
        ),
        Advice(
            "Blender rounds places: landings may be off by {error} display pixels, and glass nearer"
            " than {gap} touches. Move the rig to the origin, and the origins of its objects to"
            " their middles.",
            "Object > Set Origin > Origin to Geometry does the second.",
            "オブジェクト > 原点を設定 > 原点をジオメトリへ移動 を使います。",
        ),
        Advice(
            "The mesh costs up to about {error} display pixels, for {remedy}.",
            "More faces, by a Subdivision Surface modifier, make it less.",
            "サブディビジョンサーフェスで面を増やすと、小さくなります。",
        ),
        Advice(
            "The normals of {n} smooth triangle{s} of '{part}' contradict the shape or are missing,"
            " so that light follows the flat facets there. Mark edges there sharp (Shade Smooth by"
            " Angle), or subdivide.",
            "It is right to leave it, where the glass is cut flat.",
            "ガラスが平らにカットされている場所では、そのままでかまいません。",
        ),
        Advice(
            "The mesh of '{part}' is too irregular or too coarse to tell the curved surface in"
            " {drawn} of its smooth faces, which are followed as drawn; {curved} are followed as"
            " curved.",
            "Surface: Smooth, in the panel Object, follows all of it as curved.",
            "「オブジェクト」パネルの「サーフェス」で、すべてを曲面として扱えます。",
        ),
        Advice(
            "'{part}' is followed as drawn: its mesh is too irregular or too coarse to tell the"
            " curved surface.",
            "A Remesh and a Subdivision Surface modifier make a scan regular.",
            "スキャンデータは、リメッシュとサブディビジョンサーフェスで整えられます。",
        ),
        Advice(
            "{share} of the source image is brighter than a display's white and would be clipped:"
            " {remedy}, or export OpenEXR, which keeps it.",
            "The setting is in the panel Object, when the picture is selected.",
            "絵を選択すると、「オブジェクト」パネルにこの設定があります。",
        ),
        Advice(
            "Glare: {share} of the light that the viewer gets comes beside the glass, {where}:"
            " {remedy}.",
            "A dark card on the bench does the same for real light.",
            "実際の装置では、黒い板で光をさえぎることもできます。",
        ),
        Advice(
            "{share} of the source image is wanted darker than the black of '{display}', which"
            " shines {black_level} of its white: it stays that bright. Raise the Picture Brightness"
            " of '{picture}', or take a display of less Black Level.",
            "An OLED display has a Black Level of 0.",
            "有機 EL ディスプレイの黒レベルは 0 です。",
        ),
    ),
)

PLATE = Section(
    "The plate",
    "プレート",
    ("core/light/law_plate.py", "core/light/plate.py"),
    (
        Advice(
            "The plate '{plate}' has no area: scale it up.",
            "Fit Plate gives it the size that the light needs.",
            "「プレートを合わせる」で、光に必要な大きさになります。",
        ),
        Advice(
            "The plate '{plate}' is not flat: a plate has to be a plane.",
            "Apply no modifier that bends it.",
            "曲げるモディファイアーは使えません。",
        ),
        Advice(
            "The x axis of the plate '{plate}' does not lie in the plate, but its mirrors stand at"
            " 45 degrees to that axis: turn its mesh, and apply its scale.",
            "Object > Apply > Scale, and turn the mesh in Edit Mode.",
            "オブジェクト > 適用 > スケール を行い、編集モードでメッシュを回します。",
        ),
        Advice(
            "The plate '{plate}' is {width:g} mm wide, less than the {pitch:g} mm from mirror to"
            " mirror: scale it up or lower its pitch.",
            "The scene may be in metres where millimetres were meant.",
            "ミリメートルのつもりのシーンが、メートルになっているかもしれません。",
        ),
    ),
)

CALIBRATION = Section(
    "Calibration",
    "キャリブレーション",
    (
        "core/bench/lattice/check.py",
        "core/bench/lattice/match.py",
        "core/bench/lattice/photograph.py",
        "operators/calibrate.py",
    ),
    (
        Advice(
            "The points are not in the order of a lattice of {columns} x {rows}: number them by"
            " column and row, or set the lattice that was shown.",
            "Columns and rows are in the panel Calibration: Lattice.",
            "列と行は「キャリブレーション」の「格子」パネルにあります。",
        ),
        Advice(
            "Some points are hardly where they belong: {problems}. Correct that, or leave them"
            " out.",
            "Points that are left out cost nothing, as long as many stay.",
            "多くの点が残っていれば、除いても問題ありません。",
        ),
        Advice(
            "The points are mirrored or turned: count columns from the left and rows from the top,"
            " and hold the camera as the viewer looks.",
            "Some cameras write mirrored images of their front side.",
            "前面カメラの写真は、左右が反転していることがあります。",
        ),
        Advice(
            "The photograph seems to show the picture {way}: hold the camera as the viewer looks,"
            " show the whole lattice, or name each point in a CSV file.",
            "Look whether the display shows the image turned.",
            "ディスプレイの画像が回転していないか確かめます。",
        ),
        Advice(
            "The {n_points} points do not form the lattice of {columns} x {rows}: choose another"
            " photograph, or name each point in a CSV file.",
            "Take it in a dark room, with nothing bright beside the glass.",
            "暗い部屋で、ガラスのそばに明るいものを置かずに撮影します。",
        ),
        Advice(
            "{extra} of {n_points} points have no place in the lattice of {columns} x {rows}:"
            " remove other bright spots, or set the lattice that is shown.",
            "Cover lamps and reflections, or paint them black in the photograph.",
            "照明や反射を隠すか、写真の中で黒く塗ります。",
        ),
        Advice(
            "The viewer sees too little of the lattice to tell its points apart: compare its"
            " columns, rows and margin with the picture.",
            "Show Lattice makes a new one by the numbers in the panel.",
            "「格子を表示」で、パネルの値から作り直せます。",
        ),
        Advice(
            "No point is seen near its expected place, so that the points cannot be told apart:"
            " name each point in a CSV file.",
            "Or bring the bench nearer to the drawing first.",
            "または、まず装置を図面に近づけます。",
        ),
        Advice(
            "The photograph is turned by about 45 degrees, so left and upper cannot be told apart:"
            " turn it.",
            "Level the camera.",
            "カメラを水平にします。",
        ),
        Advice(
            "Too few of the {columns} columns and {rows} rows are seen to number them: show more"
            " of the lattice, or name each point in a CSV file.",
            "Make the picture smaller, so that all of it arrives.",
            "絵を小さくして、全体が届くようにします。",
        ),
        Advice(
            "No lattice of bright {marks} was found in the photograph: take a sharp one that shows"
            " more of the lattice.",
            "Set the style, dots or lines, to the one that is shown.",
            "点か線か、表示しているものにスタイルを合わせます。",
        ),
        Advice(
            "A photograph of {size} pixels is too small to find points in: take a larger one.",
            "Send it as a file: messengers shrink photographs.",
            "ファイルとして送ります。メッセージアプリは写真を縮小します。",
        ),
        Advice(
            "The scene has the result of '{file}' already: solve, and take another photograph of"
            " the view.",
            "Remove Offset forgets it, if you want to begin anew.",
            "最初からやり直す場合は、オフセットを取り除きます。",
        ),
        Advice(
            "Nothing may be off: set a tolerance above 0.",
            "They are under May Be Off.",
            "「キャリブレーション」の「写真」パネルの下のパネルにあります。",
        ),
        Advice(
            "Only {n_shown} of {n_points} points of the lattice are seen in this rig: compare its"
            " columns, rows and margin with the picture.",
            "Press Show Lattice and Solve once more, with the numbers as they are now.",
            "今の値のまま、もう一度「格子を表示」と「計算」を押します。",
        ),
        Advice(
            "'{file}' has {width:.0f} x {height:.0f} pixels, the viewer {viewer_width:.0f} x"
            " {viewer_height:.0f}: give the viewer's resolution the photograph's shape.",
            "Only the shape counts: 600 x 400 will do for a photograph of 6000 x 4000.",
            "縦横比だけが大切です。6000 x 4000 の写真なら、600 x 400 で十分です。",
        ),
        Advice(
            "There is nothing to calibrate by: choose a photograph or a CSV of points.",
            "The field is Measured.",
            "「キャリブレーション」の「写真」パネルの最初の欄です。",
        ),
        Advice(
            "The photograph has {width} x {height} pixels: give both numbers, or 0 for both.",
            "They are asked for with a CSV only: a photograph has its own.",
            "CSV の場合にだけ必要です。写真は自分の値を持っています。",
        ),
    ),
)

FILES = Section(
    "Files and memory",
    "ファイルとメモリ",
    (
        "core/disk.py",
        "core/free_memory.py",
        "core/image_io.py",
        "core/blender/paths.py",
        "core/blender/preview.py",
        "operators/export.py",
        "operators/command_line.py",
    ),
    (
        Advice(
            "The path '{path}' is relative to this file, which was never saved: save it or choose"
            " another.",
            "A path that begins with // is one beside the .blend.",
            "// で始まるパスは、.blend と同じ場所を指します。",
        ),
        Advice(
            "The folder '{folder}' cannot be written ({why}): choose another one.",
            "Folders of the system, and of read-only disks, are not yours to write.",
            "システムのフォルダーや読み取り専用のディスクには書き込めません。",
        ),
        Advice(
            "The file '{path}' cannot be written ({why}): check the disk or choose another name.",
            "Close the program that has it open, and make room on the disk.",
            "開いているプログラムを閉じ、ディスクの空きを増やします。",
        ),
        Advice(
            "The file '{path}' cannot be written ({why}): check the disk.",
            "Make room on the disk. A file that was there before is still whole.",
            "ディスクの空きを増やします。前からあったファイルは、そのまま残っています。",
        ),
        Advice(
            "The file '{file}' cannot be written ({why}): choose another folder.",
            "Give --out a folder of your own.",
            "--out に、ご自身のフォルダーを指定します。",
        ),
        Advice(
            "The path '{folder}' has no room for such a name ({why}): choose another.",
            "Names may have about 250 letters, fewer on some disks.",
            "名前は 250 文字ほどまでです。ディスクによっては、もっと短くなります。",
        ),
        Advice(
            "The file '{path}' cannot be read ({why}): choose another one.",
            "Open it in the Image Editor to see whether Blender can.",
            "画像エディターで開けるかどうか確かめます。",
        ),
        Advice(
            "The file '{path}' exists already: choose another name or allow overwriting.",
            "Overwrite is beside the file's name; headless it is --overwrite.",
            "ファイル名の近くに上書きの設定があります。コマンドでは --overwrite です。",
        ),
        Advice(
            "The image '{path}' cannot be read ({why}): choose another file.",
            "Save it anew as PNG in an image editor.",
            "画像エディターで、PNG として保存し直します。",
        ),
        Advice(
            "The image '{path}' is broken ({why}): choose another file.",
            "It was not written to its end: copy it again.",
            "最後まで書き込まれていません。もう一度コピーします。",
        ),
        Advice(
            "This Blender's Python has no OpenImageIO, which reads and writes the files: {remedy}.",
            "Blenders of some distributions lack it; those of blender.org have it.",
            "blender.org の Blender にはあります。ほかの配布元のものには、ない場合があります。",
        ),
        Advice(
            "The file '{path}' is not whole after writing: check the disk.",
            "The disk is full, or its network is gone. Do not use that file.",
            "ディスクが一杯か、ネットワークが切れています。そのファイルは使わないでください。",
        ),
        Advice(
            "{work} would take about {needed} GB of memory, but {free} GB are free: {remedy}.",
            "Half the resolution of the viewer takes a quarter of it.",
            "視点の解像度を半分にすると、4 分の 1 になります。",
        ),
        Advice(
            "The preview could not be written whole to the folder for temporary files, '{folder}':"
            " make room on its disk and try again.",
            "The folder is in Preferences > File Paths > Temporary Files.",
            "プリファレンス > ファイルパス > 一時ファイル で変えられます。",
        ),
        Advice(
            "Cycles wrote no preview: look in the console for its reason.",
            "A graphics card without room is the usual one: set Cycles to CPU.",
            "多くは GPU のメモリ不足です。Cycles のデバイスを CPU にします。",
        ),
        Advice(
            "The export has no path: choose a file.",
            "File, in the panel Export, is empty.",
            "「エクスポート」パネルのファイル欄が空です。",
        ),
        Advice(
            "The scene has changed since: solve again, or export the old image with"
            " allow_stale=True.",
            "In the window, Export asks instead.",
            "ウィンドウでは、代わりに確認が表示されます。",
        ),
        Advice(
            "{first}{rest}; try 'kiriko --help'.",
            "blender --background FILE --command kiriko --help lists all verbs.",
            "blender --background FILE --command kiriko --help で一覧を表示します。",
        ),
        Advice(
            "A photograph is of one rig: name it by --rig.",
            "The rigs' names are those of their collections in the outliner.",
            "リグの名前は、アウトライナーのコレクションの名前です。",
        ),
        Advice(
            "The scene has no rig that Add Rig made: leave out --rig.",
            "A rig that was made by roles alone has no name.",
            "役割だけで作ったリグには名前がありません。",
        ),
        Advice(
            "No .blend file was loaded: name an existing file before --command.",
            "Blender says nothing when it does not find the file: look at its path.",
            "Blender は、ファイルが見つからなくても何も言いません。パスを確かめます。",
        ),
    ),
)

SECTIONS = RIG, GLASS, PICTURE, RESULT, PLATE, CALIBRATION, FILES
